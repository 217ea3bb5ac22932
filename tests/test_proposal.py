# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Equations (5) to (10) in a square room without noise, and the matching they rest on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from slarm_graph.backends.particle_maps import ParticleMaps
from slarm_graph.backends.particle_matching import (
    associate,
    curvature,
    log_likelihood,
    log_likelihoods,
    log_no_match,
    point_normals,
    scale_square,
)
from slarm_graph.backends.proposal import (
    MatchRule,
    Measurement,
    body_centred_lattice,
    find_peak,
    gaussian_of,
    next_scale_m,
    propose,
    weigh,
)
from slarm_graph.config import GmappingConfig, ParticleLikelihoodConfig, ProposalConfig
from slarm_graph.geometry import Floats, compose, invert, transform_points

CONFIG = GmappingConfig(likelihood=ParticleLikelihoodConfig(sigma_m=0.03, beam_information=0.2))
RESOLUTION_M = 0.05
MOTION = np.array([0.3, 0.05, 0.1])
COVARIANCE = np.diag([0.02, 0.02, 0.01]) ** 2


def walls_m() -> Floats:
    """Points on the walls of a room of 4 m x 6 m, counter-clockwise."""
    along = np.arange(0.0, 1.0, 0.01)
    corners = np.array([[-2.0, -3.0], [2.0, -3.0], [2.0, 3.0], [-2.0, 3.0], [-2.0, -3.0]])
    sides = [a + along[:, None] * (b - a) for a, b in itertools.pairwise(corners)]
    return np.concatenate(sides)


def seen_from(pose: Floats) -> Floats:
    """The room's points with normals in the frame of a pose, (K, 4)."""
    return np.asarray(point_normals(transform_points(invert(pose), walls_m()), np.zeros(2)))


def room_maps(particles: int = 1) -> ParticleMaps:
    maps = ParticleMaps.empty(particles, RESOLUTION_M)
    maps.insert(seen_from(np.zeros(3)), np.zeros((particles, 3)))
    return maps


def lines_at(maps: ParticleMaps, points: Floats, pose: Floats) -> Floats:
    lines = np.zeros((len(points), 5))
    associate(maps.tiles, 0, 1, points, pose, lines)
    return lines


def test_normals_point_to_the_laser() -> None:
    points = seen_from(np.array([0.5, 0.5, 0.7]))
    towards = -np.einsum("ij,ij->i", points[:, :2], points[:, 2:])
    directed = (points[:, 2:] != 0.0).any(axis=1)
    assert directed.mean() > 0.95
    assert (towards[directed] > 0.0).all()


def test_normals_are_those_of_principal_axes() -> None:
    """A second implementation: eigenvectors of the covariance of what lies within half a metre."""
    rng = np.random.default_rng(2)
    along = np.sort(rng.uniform(0.0, 4.0, 40))
    points = np.column_stack([along, 2.0 + 0.5 * along + rng.normal(0.0, 0.01, 40)])
    origin = np.array([0.3, -0.2])
    found, said = point_normals(points, origin), 0
    for k, point in enumerate(points):
        near = points[max(0, k - 3) : k + 4]
        near = near[np.hypot(*(near - point).T) <= 0.5]
        variances, axes = (
            np.linalg.eigh(np.cov(near.T, bias=True)) if len(near) > 2 else (None, None)
        )
        if variances is None or variances[0] > 0.1 * variances[1]:
            assert (found[k, 2:] == 0.0).all()
            continue
        normal = axes[:, 0] * np.sign(axes[:, 0] @ (origin - point))
        np.testing.assert_allclose(found[k, 2:], normal, atol=1e-9)
        said += 1
    assert said > 30


def test_the_far_side_of_a_wall_is_another_wall() -> None:
    maps = room_maps()
    outside = walls_m()
    facing_out = np.column_stack([outside, -seen_from(np.zeros(3))[:, 2:]])
    seen = seen_from(np.zeros(3))
    assert lines_at(maps, seen, np.zeros(3))[:, 4].mean() > 0.99
    directed = (facing_out[:, 2:] != 0.0).any(axis=1)
    assert lines_at(maps, facing_out[directed], np.zeros(3))[:, 4].mean() < 0.1


def test_gradient_is_that_of_the_likelihood() -> None:
    maps, pose, step = room_maps(), np.array([0.01, -0.02, 0.004]), 1e-6
    points = seen_from(np.zeros(3))
    lines = lines_at(maps, points, pose)
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    curvature(points, lines, pose, 0.03, 0.2, hessian, gradient)
    for axis in range(3):
        d = np.zeros(3)
        d[axis] = step
        ahead, behind = (
            log_likelihood(points, lines, pose + sign * d, 0.03, -1.0) for sign in (1.0, -1.0)
        )
        assert np.isclose(gradient[axis], -0.2 * (ahead - behind) / (2.0 * step), rtol=1e-4)
    assert np.allclose(hessian, hessian.T)
    assert (np.linalg.eigvalsh(hessian) > 0.0).all()


@pytest.mark.parametrize("count", [0, 1, 31, 32, 33, 400])
def test_many_poses_are_as_likely_as_one_by_one(count: int) -> None:
    """With lines of all kinds: directed, without a direction, and none at all."""
    rng = np.random.default_rng(count)
    points, lines = rng.normal(size=(count, 4)), rng.normal(size=(count, 5))
    lines[:, 2:4] /= np.linalg.norm(lines[:, 2:4], axis=1, keepdims=True)
    lines[::5, 2:4] = 0.0
    lines[:, 4] = np.arange(count) % 3 > 0
    poses, many = rng.normal(size=(27, 3)), np.empty(27)
    log_likelihoods(points, lines, poses, 0.03, -1.5, many)
    single = [log_likelihood(points, lines, pose, 0.03, -1.5) for pose in poses]
    assert np.allclose(many, single, rtol=1e-12, atol=1e-9)


def test_eq_7_the_peak_of_a_noiseless_scan_is_the_truth() -> None:
    truth = np.array([0.31, 0.06, 0.11])
    maps, points, lines = room_maps(), seen_from(truth), np.zeros((400, 5))
    prior, rule = 1e-3 * np.linalg.inv(COVARIANCE), MatchRule(1, 0.03, 0.2, 20)
    peak, _ = find_peak(maps.tiles, 0, rule, points, MOTION, MOTION, prior, lines)
    assert np.allclose(peak, truth, atol=2e-3)


def test_eq_7_without_a_map_the_motion_decides() -> None:
    maps = ParticleMaps.empty(1, RESOLUTION_M)
    measurement = Measurement(seen_from(MOTION), MOTION, COVARIANCE)
    pose, _, _ = propose(maps, measurement, CONFIG, 0.03, np.zeros((1, 3)), np.zeros((1, 6)))
    assert np.allclose(pose[0], MOTION, atol=1e-9)


def test_eq_8_is_the_integral_over_the_motion() -> None:
    """With nothing in the map p(o | m, x) is the same everywhere, so the integral is it."""
    maps, points = ParticleMaps.empty(1, RESOLUTION_M), seen_from(MOTION)
    fine = CONFIG.model_copy(update={"proposal": ProposalConfig(lattice_radius=5.0)})
    measurement = Measurement(points, MOTION, COVARIANCE)
    _, gained, _ = propose(maps, measurement, fine, 0.03, np.zeros((1, 3)), np.zeros((1, 6)))
    expected = 0.2 * len(points) * log_no_match(1, RESOLUTION_M, 0.03)
    assert np.isclose(gained[0], expected, atol=2e-3)


def test_eq_8_prefers_the_particle_whose_map_fits() -> None:
    maps = room_maps(2)
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.2, 0.0]])
    measurement = Measurement(seen_from(MOTION), MOTION, COVARIANCE)
    _, gained, _ = propose(maps, measurement, CONFIG, 0.03, poses, np.zeros((2, 6)))
    assert gained[0] > gained[1] + 10.0


def test_eq_9_and_10_are_weighted_moments() -> None:
    rng = np.random.default_rng(0)
    offsets, log_density = rng.normal(size=(40, 3)), rng.normal(-500.0, 2.0, 40)
    mean, covariance = np.empty(3), np.empty((3, 3))
    log_eta = gaussian_of(offsets, log_density, mean, covariance)
    weights = np.exp(log_density + 500.0)
    assert np.allclose(mean, np.average(offsets, axis=0, weights=weights))
    assert np.allclose(covariance, np.cov(offsets.T, aweights=weights, ddof=0))
    assert np.isclose(log_eta, np.log(weights.sum()) - 500.0)


@pytest.mark.parametrize(("radius", "count", "share"), [(2.9, 27, 0.90), (3.4, 51, 0.97)])
def test_the_lattice_integrates_a_normal_density(radius: float, count: int, share: float) -> None:
    lattice = body_centred_lattice(radius)
    assert len(lattice) == count
    log_density = -0.5 * (lattice**2).sum(axis=1) - 1.5 * np.log(2.0 * np.pi)
    mean, covariance = np.empty(3), np.empty((3, 3))
    log_eta = gaussian_of(lattice, log_density, mean, covariance)
    assert np.isclose(4.0 * np.exp(log_eta), 1.0, atol=0.05)
    assert np.allclose(mean, 0.0)
    assert np.allclose(covariance, np.eye(3) * covariance[0, 0], atol=1e-9)
    assert covariance[0, 0] > share


def test_poses_are_drawn_from_the_proposal() -> None:
    """Many particles with one map and one past follow N(mu, Sigma) of eq. (9), (10)."""
    count = 4000
    maps = room_maps()
    maps.tables = np.repeat(maps.tables, count, axis=0)
    measurement = Measurement(seen_from(MOTION), MOTION, COVARIANCE)
    normals = np.random.default_rng(0).standard_normal((count, 6))
    few = CONFIG.model_copy(update={"proposal": ProposalConfig(iterations=3)})
    drawn, _, _ = propose(maps, measurement, few, 0.03, np.zeros((count, 3)), normals)
    mu, _, _ = propose(maps, measurement, few, 0.03, np.zeros((1, 3)), np.zeros((1, 6)))
    sigma = drawn.std(axis=0)
    assert (np.abs(drawn.mean(axis=0) - mu[0]) < 4.0 * sigma / np.sqrt(count)).all()
    assert (sigma < np.sqrt(np.diag(COVARIANCE))).all()
    assert (sigma > 1e-4).all()


def test_eq_5_and_6_weigh_by_the_likelihood() -> None:
    """Drawn from the motion model, the ratio of eq. (5) leaves p(o | m, x), eq. (6)."""
    maps = room_maps(2)
    poses = np.array([MOTION, compose(MOTION, np.array([0.04, 0.0, 0.0]))])
    points = seen_from(MOTION)
    gained = weigh(maps, points, CONFIG, poses)
    for pose, gain in zip(poses, gained, strict=True):
        lines = lines_at(maps, points, pose)
        expected = log_likelihood(points, lines, pose, 0.03, log_no_match(1, RESOLUTION_M, 0.03))
        assert np.isclose(gain, 0.2 * expected)
    assert gained[0] > gained[1]


def walls_seen_with(residuals_m: Floats) -> tuple[Floats, Floats]:
    """Points of the robot's frame, each off its line by a residual, and the lines."""
    rng = np.random.default_rng(5)
    turns = rng.uniform(0.0, 2.0 * np.pi, len(residuals_m))
    normals = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    feet = rng.uniform(-4.0, 4.0, (len(turns), 2))
    on_lines = feet + residuals_m[:, None] * normals
    points = np.concatenate([transform_points(invert(MOTION), on_lines), normals], axis=1)
    return points, np.concatenate([feet, normals, np.ones((len(turns), 1))], axis=1)


@pytest.mark.parametrize("true_scale_m", [0.004, 0.02])
@pytest.mark.parametrize("first_m", [0.03, 0.001])
def test_the_scale_of_residuals_becomes_the_most_likely_one(
    true_scale_m: float, first_m: float
) -> None:
    """A second implementation: the likelihood of the residuals over a fine row of scales."""
    residuals_m = true_scale_m * np.random.default_rng(6).standard_cauchy(400)
    points, lines = walls_seen_with(residuals_m)
    scale_m = first_m
    for _ in range(60):
        scale_m = np.sqrt(scale_square(points, lines, MOTION, scale_m))
    scales_m = np.geomspace(1e-3, 0.1, 4000)[:, None]
    log_p = -np.log(scales_m) - np.log1p((residuals_m / scales_m) ** 2)
    assert np.isclose(scale_m, scales_m[np.argmax(log_p.sum(axis=1)), 0], rtol=3e-3)


def test_what_matched_nothing_or_no_line_says_nothing_of_the_scale() -> None:
    points, lines = walls_seen_with(np.full(30, 0.01))
    alone = scale_square(points[:10], lines[:10], MOTION, 0.03)
    lines[10:20, 4], lines[20:, 2:4] = 0.0, 0.0
    points[10:, :2] += 0.05
    assert scale_square(points, lines, MOTION, 0.03) == alone
    assert np.isnan(scale_square(points[10:], lines[10:], MOTION, 0.03))


def test_the_scale_is_learned_from_many_updates() -> None:
    """Half and twice the true square by turns, as seen from any scale: their mean comes out."""
    scale_m, rng = 0.03, np.random.default_rng(7)
    learned = []
    for update in range(400):
        squares = np.array([1e-4 * rng.choice([0.5, 1.5]), 1e-4, np.nan])
        scale_m = next_scale_m(scale_m, squares, update)
        learned.append(scale_m)
    assert np.std(learned[200:]) < 0.25 * np.std(learned[:20])
    assert np.isclose(np.mean(learned[200:]), 0.01, rtol=0.02)
    assert next_scale_m(0.03, np.full(3, np.nan), 5) == 0.03
    assert next_scale_m(0.03, np.zeros(3), 0) == 1e-3  # no finer than the ascent


def test_every_particle_says_of_the_scale_what_its_own_map_does() -> None:
    """A noiseless scan in a map of its own walls, and in one of walls 0.02 m thick."""
    maps, rng = room_maps(2), np.random.default_rng(8)
    thick = seen_from(np.zeros(3))
    thick[:, :2] += rng.normal(0.0, 0.02, (len(thick), 1)) * thick[:, 2:]
    maps.insert(thick, np.array([[100.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    seen = seen_from(compose(MOTION, np.array([0.02, -0.02, 0.01])))
    measurement = Measurement(seen, MOTION, COVARIANCE)
    _, _, squares = propose(maps, measurement, CONFIG, 0.03, np.zeros((2, 3)), np.zeros((2, 6)))
    assert np.sqrt(squares[0]) < 1e-3 < 2e-3 < np.sqrt(squares[1])


def test_after_a_motion_not_followed_some_of_the_particles_find_the_place() -> None:
    truth = compose(MOTION, np.array([0.25, -0.2, 0.1]))
    covariance = np.diag([0.25, 0.25, 0.12]) ** 2
    maps = room_maps(60)
    normals = np.random.default_rng(0).standard_normal((60, 6))
    measurement = Measurement(seen_from(truth), MOTION, covariance, is_lost=True)
    poses, gained, _ = propose(maps, measurement, CONFIG, 0.03, np.zeros((60, 3)), normals)
    assert np.allclose(poses[np.argmax(gained)], truth, atol=0.03)


@pytest.mark.parametrize("off", [(0.03, 0.0, 0.0), (-0.01, 0.04, 0.02), (0.0, -0.03, -0.02)])
def test_eq_7_to_10_are_those_of_the_product_summed_over_a_fine_lattice(
    off: tuple[float, float, float],
) -> None:
    """The scan was taken away from where the motion leads; the prior stays where that is."""
    covariance = np.diag([0.03, 0.03, 0.02]) ** 2
    likelihood = ParticleLikelihoodConfig(sigma_m=0.1, beam_information=0.02)
    config = CONFIG.model_copy(
        update={
            "likelihood": likelihood,
            "proposal": ProposalConfig(lattice_radius=6.0, iterations=20),
        }
    )
    maps, points = room_maps(), seen_from(compose(MOTION, np.array(off)))
    measurement = Measurement(points, MOTION, covariance)
    pose, gained, _ = propose(maps, measurement, config, 0.1, np.zeros((1, 3)), np.zeros((1, 6)))
    information = np.linalg.inv(covariance)
    c, s = np.cos(MOTION[2]), np.sin(MOTION[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    prior, lines = turn @ information @ turn.T, np.zeros((len(points), 5))
    rule = MatchRule(config.proposal.kernel_size, 0.1, 0.02, 20)
    peak, hessian = find_peak(maps.tiles, 0, rule, points, MOTION, MOTION, prior, lines)
    axis = np.linspace(-6.0, 6.0, 31)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    root = np.linalg.cholesky(np.linalg.inv(hessian))
    tried, logs = peak + grid @ root.T, np.empty(len(grid))
    miss = log_no_match(config.proposal.kernel_size, RESOLUTION_M, 0.1)
    log_likelihoods(points, lines, tried, 0.1, miss, logs)
    away = tried - MOTION
    log_prior = -0.5 * np.einsum("na,ab,nb->n", away, prior, away)
    log_prior += 0.5 * np.log(np.linalg.det(information) / (2.0 * np.pi) ** 3)
    logs = 0.02 * logs + log_prior
    density = np.exp(logs - logs.max())
    mean = (density[:, None] * tried).sum(axis=0) / density.sum()
    assert np.hypot(*(mean - MOTION)[:2]) > 0.002
    assert np.allclose(pose[0], mean, atol=2e-4)
    volume = np.linalg.det(root) * (axis[1] - axis[0]) ** 3
    assert gained[0] == pytest.approx(logs.max() + np.log(density.sum() * volume), abs=0.05)
