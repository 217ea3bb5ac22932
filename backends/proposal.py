# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The improved proposal, eq. (7)-(10): p(x_t | m, x_t-1, o_t, l_t-1) of every particle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slarm_graph.backends.particle_maps import ParticleMaps, Tiles
from slarm_graph.backends.particle_matching import (
    associate,
    curvature,
    log_likelihood,
    log_likelihoods,
    log_no_match,
    scale_square,
)
from slarm_graph.config import GmappingConfig
from slarm_graph.frontends.scans.small_pose import moved
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_CONVERGED_M, _CONVERGED_RAD = 1e-3, 5e-4
"""Steps below which the ascent has converged: a fiftieth of a map's cell, and as much at 2 m."""
_STEPS_PER_ASSOCIATION = 2
"""Gauss-Newton steps between two data associations, which take several times as long."""
_LATTICE_CELL_VOLUME = 4.0
"""Volume per point of the body-centred lattice of side 2: two points to a cube of 8."""
_LEARNING_EXPONENT = 0.6
"""The k-th update's share of the learned scale is k^-0.6, as Cappe and Moulines advise: the last 16
of a hundred updates count, the last 60 of a thousand."""
_TINY_VARIANCE = 1e-12
"""Added to a covariance so that it can be factorised: a thousandth of a millimetre."""


def body_centred_lattice(radius: float) -> Floats:
    """Return all (even, even, even) and (odd, odd, odd) points (Z, 3) within a radius.

    Of all lattices this one needs the fewest points for the sums of eq. (8)-(10): with 27 points
    (radius 2.9) a standard normal density sums to 0.97 with 0.91 of its covariance, with 51
    (radius 3.4) to 0.99 with 0.97.
    """
    axis = np.arange(-math.ceil(radius), math.ceil(radius) + 1)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    same_parity = (grid % 2 == grid[:, :1] % 2).all(axis=1)
    near = np.linalg.norm(grid, axis=1) <= radius
    return np.asarray(grid[same_parity & near], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Measurement:
    """Input of one filter update.

    Parameters
    ----------
    points : (K, 4) float64
        End points [m] and normals in the robot's frame.
    motion : (3,) float64
        Pose of the robot relative to the previous update [m, m, rad].
    motion_covariance : (3, 3) float64
        Of `motion`, in the body frame at its end.
    is_lost : bool
        The frontend lost track in between, so the ascent starts from a draw of the motion model for
        every particle instead of from its mean.
    path_m, turned_rad : float
        Path length and sum of absolute rotations.
    """

    points: Floats
    motion: Floats
    motion_covariance: Floats
    is_lost: bool = False
    path_m: float = 0.0
    turned_rad: float = 0.0


class MatchRule(NamedTuple):
    """Parameters of the scan likelihood.

    Parameters
    ----------
    kernel : int
        Cells around its own in which a point is associated.
    sigma, gain : float
        Scale of a point's distance [m], and weight of its log likelihood.
    iterations : int
        Data associations of the ascent, at most.
    """

    kernel: int
    sigma: float
    gain: float
    iterations: int


def propose(
    maps: ParticleMaps,
    measurement: Measurement,
    config: GmappingConfig,
    scale_m: float,
    poses: Floats,
    normals: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Draw new poses of some particles and increments of their log weights, eq. (7)-(10).

    Parameters
    ----------
    maps : ParticleMaps
        Of just these particles.
    measurement : Measurement
    config : GmappingConfig
    scale_m : float
        Scale of the distance between a return and its wall.
    poses : (P, 3) float64
        At the previous update.
    normals : (P, 6) float64
        Standard normal draws: three for the pose and three for the start of a lost particle.

    Returns
    -------
    poses : (P, 3) float64
    log_weights : (P,) float64
    scale_squares : (P,) float64
        What the scan says of the scale, for `next_scale_m` [m^2].
    """
    return _propose(
        maps.tiles,
        _rule(config, scale_m),
        measurement.points,
        measurement.motion,
        measurement.motion_covariance,
        measurement.is_lost,
        body_centred_lattice(config.proposal.lattice_radius),
        poses,
        normals,
    )


def weigh(maps: ParticleMaps, points: Floats, config: GmappingConfig, poses: Floats) -> Floats:
    """Log likelihood (P,) of a scan at poses drawn from the motion model, eq. (6).

    At the scale of the settings: what such poses are off is not the noise of the returns.
    """
    return np.asarray(_weigh(maps.tiles, _rule(config, config.likelihood.sigma_m), points, poses))


def place_in_map(
    maps: ParticleMaps,
    particle: int,
    points: Floats,
    config: GmappingConfig,
    scale_m: float,
    covariance: Floats,
) -> Floats:
    """Pose (3,) near the origin at which a scan fits the map of a particle, eq. (7).

    Parameters
    ----------
    maps : ParticleMaps
    particle : int
    points : (K, 4) float64
    config : GmappingConfig
    scale_m : float
    covariance : (3, 3) float64
        Of the pose about the origin, before the map is asked [m, m, rad].
    """
    prior, lines = np.linalg.inv(covariance).astype(np.float64), np.zeros((len(points), 5))
    start, rule = np.zeros(3), _rule(config, scale_m)
    peak, _ = find_peak(maps.tiles, particle, rule, points, start, start, prior, lines)
    return np.asarray(peak)


def next_scale_m(scale_m: float, squares: Floats, updates: int) -> float:
    """Learn the scale of the distance between returns and walls from one update more [m].

    Online expectation maximisation (Cappe and Moulines, "On-line Expectation-Maximization Algorithm
    for Latent Data Models", JRSS B 71(3), 2009). A likelihood wider than the noise makes every draw
    of a pose noisier than the match is, which is what a path over new ground then drifts by.

    Parameters
    ----------
    scale_m : float
        So far.
    squares : (P,) float64
        `scale_square` of the scan for every particle [m^2]; NaN where nothing matched.
    updates : int
        Before this one.
    """
    known = squares[np.isfinite(squares)]
    if not len(known):
        return scale_m
    share = (updates + 1.0) ** -_LEARNING_EXPONENT
    square = (1.0 - share) * scale_m**2 + share * float(known.mean())
    return max(_CONVERGED_M, math.sqrt(square))


def _rule(config: GmappingConfig, scale_m: float) -> MatchRule:
    likelihood, proposal = config.likelihood, config.proposal
    return MatchRule(
        proposal.kernel_size,
        scale_m,
        likelihood.beam_information,
        proposal.iterations,
    )


@kernel
def _weigh(tiles: Tiles, rule: MatchRule, points: Floats, poses: Floats) -> Floats:
    log_weights = np.empty(len(poses))
    lines = np.zeros((len(points), 5))
    miss = log_no_match(rule.kernel, tiles.resolution, rule.sigma)
    for p in range(len(poses)):
        associate(tiles, p, rule.kernel, points, poses[p], lines)
        log_weights[p] = rule.gain * log_likelihood(points, lines, poses[p], rule.sigma, miss)
    return log_weights


@kernel
def _propose(
    tiles: Tiles,
    rule: MatchRule,
    points: Floats,
    motion: Floats,
    motion_covariance: Floats,
    is_lost: bool,
    lattice: Floats,
    poses: Floats,
    normals: Floats,
) -> tuple[Floats, Floats, Floats]:
    new_poses, log_weights = np.empty((len(poses), 3)), np.empty(len(poses))
    squares = np.empty(len(poses))
    lines = np.zeros((len(points), 5))
    miss = log_no_match(rule.kernel, tiles.resolution, rule.sigma)
    log_density, mean, covariance = np.empty(len(lattice)), np.empty(3), np.empty((3, 3))
    information = np.linalg.inv(motion_covariance).astype(np.float64)
    scatter = np.linalg.cholesky(motion_covariance)
    if not is_lost:
        scatter[:] = 0.0
    for p in range(len(poses)):
        predicted = moved(poses[p], motion)
        prior = in_map_axes(information, predicted[2])
        start = moved(predicted, scatter @ normals[p, 3:])
        peak, hessian = find_peak(tiles, p, rule, points, start, predicted, prior, lines)
        squares[p] = scale_square(points, lines, peak, rule.sigma)
        root = np.linalg.cholesky(np.linalg.inv(hessian))
        offsets = lattice @ root.T
        log_likelihoods(points, lines, peak + offsets, rule.sigma, miss, log_density)
        for j in range(len(lattice)):
            # log of p(o | m, x_j) p(x_j | x_t-1, l_t-1), eq. (7)
            e = peak + offsets[j] - predicted
            log_density[j] = rule.gain * log_density[j] - 0.5 * quadratic(prior, e)
        log_sum = gaussian_of(offsets, log_density, mean, covariance)
        new_poses[p] = peak + mean + np.linalg.cholesky(covariance) @ normals[p, :3]
        new_poses[p, 2] = math.atan2(math.sin(new_poses[p, 2]), math.cos(new_poses[p, 2]))
        # eq. (8): the sum stands for an integral, so the volume of a lattice cell belongs to it,
        # and the normalisation of the motion's density
        volume = root[0, 0] * root[1, 1] * root[2, 2] * _LATTICE_CELL_VOLUME
        normalisation = 0.5 * math.log(np.linalg.det(information) / (2.0 * math.pi) ** 3)
        log_weights[p] = log_sum + math.log(volume) + normalisation
    return new_poses, log_weights, squares


@kernel
def gaussian_of(offsets: Floats, log_density: Floats, mean: Floats, covariance: Floats) -> float:
    """Fill mean (3,), eq. (9), and covariance (3, 3), eq. (10); return log eta.

    Parameters
    ----------
    offsets : (Z, 3) float64
        The z poses as seen from the peak [m, m, rad].
    log_density : (Z,) float64
        log of p(o | m, x_j) p(x_j | x_t-1, l_t-1).
    """
    top = log_density.max()
    density = np.exp(log_density - top)
    eta = density.sum()
    mean[:] = 0.0
    covariance[:] = 0.0
    for j in range(len(offsets)):
        mean += density[j] / eta * offsets[j]  # eq. (9)
    for j in range(len(offsets)):
        d = offsets[j] - mean
        for a in range(3):
            for b in range(3):
                covariance[a, b] += density[j] / eta * d[a] * d[b]  # eq. (10)
    for a in range(3):
        covariance[a, a] += _TINY_VARIANCE
    return float(top + math.log(eta))


@kernel
def find_peak(
    tiles: Tiles,
    particle: int,
    rule: MatchRule,
    points: Floats,
    start: Floats,
    predicted: Floats,
    prior: Floats,
    lines: Floats,
) -> tuple[Floats, Floats]:
    """Maximise p(o | m, x) p(x | x_t-1, l_t-1) by Gauss-Newton; return the peak and its Hessian.

    `lines` is left with the associations at the peak.
    """
    peak, hessian, gradient = start.copy(), np.empty((3, 3)), np.empty(3)
    for _ in range(rule.iterations):
        associate(tiles, particle, rule.kernel, points, peak, lines)
        before = peak.copy()
        for _ in range(_STEPS_PER_ASSOCIATION):
            hessian[:] = prior
            gradient[:] = prior @ (peak - predicted)
            curvature(points, lines, peak, rule.sigma, rule.gain, hessian, gradient)
            peak -= np.linalg.solve(hessian, gradient)
        step = peak - before
        if abs(step[0]) + abs(step[1]) < _CONVERGED_M and abs(step[2]) < _CONVERGED_RAD:
            break
    associate(tiles, particle, rule.kernel, points, peak, lines)
    hessian[:] = prior
    curvature(points, lines, peak, rule.sigma, rule.gain, hessian, gradient)
    return peak, hessian


@kernel
def in_map_axes(information: Floats, heading_rad: float) -> Floats:
    """Turn an information matrix (3, 3) of the body frame into the map's axes."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    a = np.zeros((3, 3))
    a[0, 0], a[0, 1], a[1, 0], a[1, 1], a[2, 2] = c, -s, s, c, 1.0
    return a @ information @ a.T


@kernel
def quadratic(matrix: Floats, vector: Floats) -> float:
    """Return v^T M v for three dimensions."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += vector[a] * matrix[a, b] * vector[b]
    return total
