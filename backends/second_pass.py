# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Second pass of the particle filter along a graph's path, where all particles missed a loop.

A few particles only cover the drift of a short path. Where none is left that closes a loop, no
weight can select it, and every map is torn. The pose graph's closures tell when that has happened;
the motion along its path is then a better proposal than the tracker's, and the filter draws, weighs
and maps as ever. It is the look-ahead of an auxiliary particle filter (Pitt and Shephard,
"Filtering via Simulation: Auxiliary Particle Filters", JASA 94(446), 1999) with the whole recording
to look at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from slarm_graph.backends.graph_building import ClosedGraph
from slarm_graph.backends.motion_model import motion_covariance
from slarm_graph.backends.path_covariance import path_covariances
from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.rbpf import TOLERANCE_RAD, MappingFilter
from slarm_graph.backends.variance_components import calibrated
from slarm_graph.config import GmappingConfig
from slarm_graph.constraint import ConstraintKind
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE
from slarm_graph.geometry import Floats, between, compose, transform_covariances, wrap_angles

MISSED_SIGMAS = math.sqrt(CHI2_1_PERMILLE)
"""Mahalanobis distance from which a closure is missed: the root of the chi-square quantile of
99.9 % for 3 degrees of freedom."""
_REVERSION_M = 10.0
"""Path length of the mean reversion to the path: with steps that err by 2 cm a metre particles
spread by sqrt(10 / 2) of that around it, 4.5 cm, a cell of their maps. From 5 to 20 m intel changes
by 2 %, mit-csail cut to 5.6 m of range by 9 %."""


def closure_mahalanobis(closed: ClosedGraph, poses: Floats, cell_m: float) -> Floats:
    """Mahalanobis distances (C,) of the loop closures at the poses of a path.

    Parameters
    ----------
    closed : ClosedGraph
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    cell_m : float
        Side of a cell of the maps along it: smaller errors tear nothing.
    """
    at_nodes = poses[closed.scans]
    # Within a cell anything is as likely: the variance of a uniform distribution.
    tolerance = np.diag([cell_m, cell_m, TOLERANCE_RAD]) ** 2 / 12.0
    distances = []
    for c in closed.graph.constraints:
        if c.kind is not ConstraintKind.LOOP_CLOSURE:
            continue
        residual = between(c.i_from_j.as_array(), between(at_nodes[c.i], at_nodes[c.j]))
        residual[2] = wrap_angles(residual[2])
        distances.append(math.sqrt(residual @ np.linalg.solve(c.covariance + tolerance, residual)))
    return np.array(distances)


def second_moments(poses: Floats, closed: ClosedGraph) -> Floats | None:
    """Second moments of the true poses about a path, by the covariances of a graph.

    With the graph's covariance C and the path at d from it: C + d d^T. The particles themselves
    cannot tell, as they share a common ancestor.

    Parameters
    ----------
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    closed : ClosedGraph

    Returns
    -------
    (S, 3, 3) float64 or None
        In the body frame [m^2, m rad, rad^2]; None where the graph has none.
    """
    graph = calibrated(closed.graph)
    covariances = path_covariances(graph, closed.scans, closed.poses, closed.variances)
    if covariances is None:
        return None
    offsets = between(poses, closed.poses)
    offsets[:, 2] = wrap_angles(offsets[:, 2])
    about_path = transform_covariances(offsets, covariances + closed.lag_covariances)
    return about_path + offsets[:, :, None] * offsets[:, None, :]


def filter_along(
    poses: Floats,
    first_points: Floats,
    measurements: Sequence[Measurement],
    config: GmappingConfig,
    rng: Generator,
) -> MappingFilter:
    """Filter a recording with the motion along a given path.

    Parameters
    ----------
    poses : (U, 3) float64
        `map_from_robot` at the first scan and at every measurement.
    first_points : (K, 4) float64
        End points and normals of the first scan.
    measurements : sequence of Measurement
        Of the first pass, U - 1.
    config : GmappingConfig
    rng : numpy.random.Generator

    Returns
    -------
    MappingFilter
        After the last measurement; its origin is the first pose.
    """
    particles = MappingFilter.empty(config)
    # Walls are as thick as the path errs, not as returns do: a likelihood as narrow as those would
    # hold particles where a first map, a few centimetres off, has begun.
    particles.learns_scale = False
    particles.start(first_points)
    path = between(poses[0], poses)
    for m, before, now in zip(measurements, path[:-1], path[1:], strict=True):
        noise = motion_covariance(config.motion, m.path_m, m.turned_rad)
        replaced = replace(m, motion=between(before, now), motion_covariance=noise, is_lost=False)
        particles.poses = mean_reverted(particles.poses, before, m.path_m)
        particles.step(replaced, rng)
    return particles


def mean_reverted(poses: Floats, path: Floats, path_m: float) -> Floats:
    """Decay the deviations of poses (P, 3) from the path's pose (3,) over a path length.

    The errors of a path that closes loops are no random walk but revert to the mean: an
    Ornstein-Uhlenbeck process.
    """
    return compose(path, math.exp(-path_m / _REVERSION_M) * between(path, poses))
