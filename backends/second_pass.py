# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Particles that all missed a loop are brought back: the filter goes over the recording again.

A few particles only cover the drift of a short way. Where none is left that closes a loop, no
weight can choose it, and every map is torn. Old places that were recognised by how they look tell
when that has happened; the motion along a path that closes those loops then is a better proposal
than the one along the tracker's, and the filter draws, weighs and maps as ever. It is the
look-ahead of an auxiliary filter (Pitt and Shephard, "Filtering via Simulation: Auxiliary Particle
Filters", JASA 94(446), 1999) with the whole recording to look at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from slarm_graph.backends.graph_building import ClosedGraph
from slarm_graph.backends.motion_model import motion_covariance
from slarm_graph.backends.path_covariance import carried, path_covariances
from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.backends.variance_components import calibrated
from slarm_graph.config import GmappingConfig
from slarm_graph.constraint import ConstraintKind
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE
from slarm_graph.geometry import Floats, adjoints, between, compose, wrap_angles

MISSED = math.sqrt(CHI2_1_PERMILLE)
"""Standard deviations by which a closure is missed: the root of the chi-square quantile of 99.9 %
for 3 degrees of freedom."""
_PULL_M = 10.0
"""Way in which particles return to the path: with steps that err by 2 cm a metre they spread by
sqrt(10 / 2) of that around it, 4.5 cm, a cell of their maps. From 5 to 20 m intel changes by 2 %,
mit-csail cut to 5.6 m of range by 9 %."""
_MAP_RAD = 0.02
"""How much a particle's map may bend between two visits without being torn: a cell at 2.5 m."""


def closure_misses(closed: ClosedGraph, poses: Floats, cell_m: float) -> Floats:
    """How far a path misses loop closures, in standard deviations (C,).

    Parameters
    ----------
    closed : ClosedGraph
    poses : (S, 3) float64
        `map_from_robot` at every scan, by the path in question.
    cell_m : float
        Side of a cell of the maps that belong to it: finer, nothing tears.
    """
    at_nodes = poses[closed.scans]
    allowed = np.diag([cell_m, cell_m, _MAP_RAD]) ** 2
    misses = []
    for c in closed.graph.constraints:
        if c.kind is not ConstraintKind.LOOP_CLOSURE:
            continue
        miss = between(c.i_from_j.as_array(), between(at_nodes[c.i], at_nodes[c.j]))
        miss[2] = wrap_angles(miss[2])
        misses.append(math.sqrt(miss @ np.linalg.solve(c.covariance + allowed, miss)))
    return np.array(misses)


def covariances_about(poses: Floats, closed: ClosedGraph) -> Floats | None:
    """Mean squares of what a path may be off, by a graph that has closed the same loops.

    The graph's error has the covariance C, and the path lies d beside it: about the path, the truth
    has the second moment C + d d^T. Particles of one ancestor cannot tell, they all share it.

    Parameters
    ----------
    poses : (S, 3) float64
        `map_from_robot` at every scan, by the path in question.
    closed : ClosedGraph

    Returns
    -------
    (S, 3, 3) float64 or None
        In the body frame [m^2, m rad, rad^2]; None where the graph has none.
    """
    graph = calibrated(closed.graph)
    known = path_covariances(graph, closed.scans, closed.poses, closed.variances)
    if known is None:
        return None
    beside = between(poses, closed.poses)
    beside[:, 2] = wrap_angles(beside[:, 2])
    about = carried(known + closed.lag_covariances, adjoints(beside))
    return about + beside[:, :, None] * beside[:, None, :]


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
        What the first scan sees.
    measurements : sequence of Measurement
        Of the filter that went before, U - 1.
    config : GmappingConfig
    rng : numpy.random.Generator

    Returns
    -------
    MappingFilter
        After the last measurement; its origin is the first pose.
    """
    particles = MappingFilter.empty(config)
    particles.start(first_points)
    path = between(poses[0], poses)
    for m, before, now in zip(measurements, path[:-1], path[1:], strict=True):
        noise = motion_covariance(config.motion, m.path_m, m.turned_rad)
        told = replace(m, motion=between(before, now), motion_covariance=noise, is_lost=False)
        particles.poses = pulled(particles.poses, before, m.path_m)
        particles.step(told, rng)
    return particles


def pulled(poses: Floats, path: Floats, path_m: float) -> Floats:
    """Let what poses (P, 3) are off the path's pose (3,) decay along a way.

    A path that is known to close loops is no random walk: what it errs by in one stretch it makes
    good in another. The process with that property is the one of Ornstein and Uhlenbeck.
    """
    return compose(path, math.exp(-path_m / _PULL_M) * between(path, poses))
