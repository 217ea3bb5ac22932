# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The field between walls against dense algebra; readings against numerical derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse, stats

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.factor import Factor
from slarm_graph.radio.measured.fit import Hyperparameters, Problem
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.posterior import Coefficients, FactoredModel
from slarm_graph.radio.measured.priors import (
    FloorField,
    Precision,
    drift_precision,
    field_correlation,
)
from slarm_graph.radio.measured.readings import Receiver, RssReadings, gaussian_equivalent
from slarm_graph.radio.measured.validate import _bridge

GRID = GridGeometry(0.0, 0.0, 0.1, 40, 60)


def two_rooms():
    """A wall at column 30 with a door at its top."""
    free = np.ones(GRID.shape, dtype=bool)
    free[:34, 30] = False
    return free


def test_nodes_cover_the_floor_and_no_node_passes_a_wall():
    free = two_rooms()
    nodes = make_nodes(GRID, free, 0.4, 10_000)
    assert nodes.area_m2.sum() == pytest.approx(free.sum() * 0.01)
    assert ((nodes.of_cell >= 0) == free).all()
    left, right = nodes.of_cell[:32, :30], nodes.of_cell[:32, 31:]
    assert not np.isin(left, right).any()
    np.testing.assert_allclose(nodes.stiffness.sum(axis=0), 0.0, atol=1e-9)
    few = make_nodes(GRID, free, 0.1, 50)
    assert len(few) <= 75


def test_points_between_nodes_share_in_those_they_border_on_and_in_none_behind_a_wall():
    """Second implementation: every node in turn, its share by the distance of the centres."""
    nodes, rng = make_nodes(GRID, two_rooms(), 0.4, 10_000), np.random.default_rng(3)
    points = rng.uniform([0.1, 0.1], [2.8, 3.2], (50, 2))
    weights = nodes.weights(points).toarray()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    dense = nodes.stiffness.toarray()
    for point, row in zip(points, weights, strict=True):
        own = nodes.at(point[None])[0]
        beside = np.flatnonzero(dense[own])
        reach = np.linalg.norm(nodes.centers_m[beside] - nodes.centers_m[own], axis=1).max()
        away = np.linalg.norm(nodes.centers_m[beside] - point, axis=1)
        expected = np.zeros(len(nodes))
        expected[beside] = np.maximum(0.0, 1.0 - away / reach)
        np.testing.assert_allclose(row, expected / expected.sum(), atol=1e-12)
    right = nodes.centers_m[:, 0] > 3.0
    np.testing.assert_array_equal(weights[:, right & (nodes.centers_m[:, 1] < 3.2)], 0.0)
    at_centers = nodes.weights(nodes.centers_m).toarray()
    np.testing.assert_array_equal(at_centers.argmax(axis=1), np.arange(len(nodes)))


def test_factor_is_the_dense_inverse():
    nodes = make_nodes(GRID, two_rooms(), 0.4, 10_000)
    matrix = FloorField(nodes).unit_precision(2.0).matrix
    dense = matrix.toarray()
    inverse = np.linalg.inv(dense)
    any_order = np.random.default_rng(3).permutation(len(dense)).astype(np.int32)
    other = FloorField(nodes).unit_precision(1.4).matrix
    for factor in (Factor(matrix), Factor(matrix, Factor(other).order), Factor(matrix, any_order)):
        np.testing.assert_allclose(factor.marginal_variances(), np.diag(inverse), rtol=1e-9)
        assert factor.log_determinant() == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-9)
        np.testing.assert_allclose(factor.solve(np.eye(len(dense))), inverse, atol=1e-9)
        np.testing.assert_allclose(factor.solve(dense[0]), np.eye(len(dense))[0], atol=1e-9)
        traces = [np.trace(inverse @ other.toarray()), len(dense)]
        np.testing.assert_allclose(factor.traces([other, matrix]), traces, rtol=1e-9)
    assert Factor(matrix, any_order)._lu.L.nnz > 2 * Factor(matrix, Factor(other).order)._lu.L.nnz


def test_field_has_its_correlation_in_the_open_and_is_parted_by_walls():
    wide = GridGeometry(0.0, 0.0, 0.1, 90, 90)
    nodes = make_nodes(wide, np.ones(wide.shape, dtype=bool), 0.2, 10_000)
    covariance = np.linalg.inv(FloorField(nodes).unit_precision(2.0).matrix.toarray())
    np.testing.assert_allclose(np.diag(covariance), 1.0, rtol=1e-6)
    middle = nodes.at(np.array([[4.5, 4.5]]))[0]
    away = np.linalg.norm(nodes.centers_m - nodes.centers_m[middle], axis=1)
    near = away < 2.0
    np.testing.assert_allclose(
        covariance[middle, near], field_correlation(away[near], 2.0), atol=0.05
    )
    parted = make_nodes(GRID, two_rooms(), 0.2, 10_000)
    covariance = np.linalg.inv(FloorField(parted).unit_precision(1.5).matrix.toarray())
    here, behind, beside = parted.at(np.array([[2.85, 0.5], [3.25, 0.5], [2.45, 0.5]]))
    assert covariance[here, beside] > field_correlation(np.array(0.4), 1.5)
    assert covariance[here, behind] < 0.02


def test_field_is_nearly_as_rough_as_shadowing_of_exponential_correlation():
    """A smooth field is off by 0.04, and has lost a third of what that loses over 0.2 m."""
    away_m = np.arange(0.02, 8.0, 0.01)
    off = field_correlation(away_m, 4.0) - np.exp(-away_m / 2.0)
    assert np.sqrt((off**2).mean()) < 0.02
    lost, wanted = 1.0 - field_correlation(np.array(0.2), 4.0), 1.0 - np.exp(-0.1)
    assert 0.5 * wanted < lost < wanted
    assert field_correlation(np.array([0.0, 4.0]), 4.0) == pytest.approx([1.0, 0.14], abs=0.002)


def test_drift_is_an_ornstein_uhlenbeck_process():
    times = np.array([0.0, 1.0, 4.0, 4.5])
    precision = drift_precision(times, 2.0)
    covariance = np.exp(-np.abs(times[:, None] - times) / 2.0)
    np.testing.assert_allclose(np.linalg.inv(precision.matrix.toarray()), covariance, atol=1e-9)
    assert precision.log_determinant == pytest.approx(-np.linalg.slogdet(covariance)[1])


def test_gains_are_those_of_the_evidence_under_a_prior_and_noise_nearby():
    rng = np.random.default_rng(4)
    floor = FloorField(make_nodes(GRID, two_rooms(), 0.5, 10_000))
    points = rng.uniform([0.2, 0.2], [5.8, 3.8], (80, 2))
    observation, design = floor.nodes.weights(points), rng.normal(size=(80, 2))
    readings, weights = 3.0 * rng.normal(size=80), rng.uniform(0.5, 2.0, 80)
    coefficients = Coefficients(np.array([1.0, -2.0]), np.array([3.0, 0.5]))

    def told(range_m: float, noise: Floats) -> tuple[Precision, Floats]:
        return floor.unit_precision(range_m), weights * noise

    def evidence(prior: Precision, precision: Floats) -> float:
        return (
            FactoredModel(prior, observation, precision)
            .condition(design, coefficients, readings)
            .log_evidence
        )

    one = np.ones(80)
    here = FactoredModel(floor.unit_precision(2.0), observation, weights)
    towards = (1.0, 0.0 * one), (0.0, one), (0.5, rng.normal(size=80))
    near = [told(2.0 * np.exp(1e-5 * a), np.exp(1e-5 * b)) for a, b in towards]
    changes = here.evidence_changes(
        here.condition(design, coefficients, readings), design, readings, near
    )
    for (a, b), gain in zip(towards, changes, strict=True):
        up, down = (told(2.0 * np.exp(h * a), np.exp(h * b)) for h in (1e-4, -1e-4))
        slope = (evidence(*up) - evidence(*down)) / 2e-4
        assert abs(slope) > 0.1
        assert gain / 1e-5 == pytest.approx(slope, rel=1e-3)


def test_conditioning_is_universal_kriging():
    rng = np.random.default_rng(1)
    nodes = make_nodes(GRID, two_rooms(), 0.5, 10_000)
    prior = FloorField(nodes).unit_precision(2.0)
    count, size = 80, len(nodes)
    observation = sparse.csr_array(
        (np.ones(count), (np.arange(count), rng.integers(0, size, count))), shape=(count, size)
    )
    design = rng.normal(size=(count, 2))
    noise = rng.uniform(0.5, 2.0, count)
    readings = rng.normal(size=count) * 3.0
    coefficients = Coefficients(np.array([1.0, -2.0]), np.array([3.0, 0.5]))
    got = FactoredModel(prior, observation, 1.0 / noise).condition(design, coefficients, readings)

    field = np.linalg.inv(prior.matrix.toarray())
    spread = np.diag(coefficients.sd**2)
    a = observation.toarray()
    total = a @ field @ a.T + design @ spread @ design.T + np.diag(noise)
    residual = readings - design @ coefficients.mean
    expected = stats.multivariate_normal(np.zeros(count), total).logpdf(residual)
    assert got.log_evidence == pytest.approx(expected, rel=1e-9)
    new_where = sparse.csr_array(np.eye(size)[:5])
    new_design = rng.normal(size=(5, 2))
    cross = new_where.toarray() @ field @ a.T + new_design @ spread @ design.T
    mean = new_design @ coefficients.mean + cross @ np.linalg.solve(total, residual)
    own = new_where.toarray() @ field @ new_where.toarray().T + new_design @ spread @ new_design.T
    variance = np.diag(own - cross @ np.linalg.solve(total, cross.T))
    np.testing.assert_allclose(got.mean(new_design, new_where), mean, atol=1e-9)
    np.testing.assert_allclose(got.variance(new_design, new_where), variance, atol=1e-9)


def log_of_silence(level, threshold, sigma, lost):
    return np.log(lost + (1.0 - lost) * stats.norm.cdf((threshold - level) / sigma))


@pytest.mark.parametrize("level", [-95.0, -90.0, -84.0])
def test_silence_has_the_slope_and_curvature_of_its_likelihood(level):
    receiver, sigma, step = Receiver(-90.0, lost_share=0.01), 4.0, 1e-3
    values, weights = gaussian_equivalent(
        np.array([np.nan]), np.array([level]), np.array([sigma**2]), receiver, 8.0
    )
    low, at, high = (log_of_silence(level + d, -90.0, sigma, 0.01) for d in (-step, 0.0, step))
    slope = (high - low) / (2 * step)
    curve = -(high - 2 * at + low) / step**2
    assert weights[0] / sigma**2 * (values[0] - level) == pytest.approx(slope, rel=1e-4)
    assert weights[0] / sigma**2 == pytest.approx(curve, rel=1e-2)


def test_lost_packets_of_a_strong_signal_say_nothing():
    receiver = Receiver(-90.0, lost_share=0.1)
    values, weights = gaussian_equivalent(
        np.array([np.nan]), np.array([-50.0]), np.array([16.0]), receiver, 8.0
    )
    assert weights[0] < 1e-5
    assert abs(weights[0] * (values[0] + 50.0)) < 1e-5


def test_outliers_weigh_less_and_saturated_readings_only_push_up():
    rss = np.array([-60.0, -90.0, -40.0, -40.0])
    expected = np.array([-60.0, -60.0, -20.0, -60.0])
    receiver = Receiver(saturation_dbm=-40.0)
    values, weights = gaussian_equivalent(rss, expected, np.full(4, 16.0), receiver, 5.0)
    assert weights[0] == pytest.approx(1.2)
    assert weights[1] < 0.15
    assert weights[2] < 1e-3
    assert values[3] > -60.0


def test_drift_between_kept_times_is_kriged_from_both_ends():
    """Second implementation: the simple kriging of an Ornstein-Uhlenbeck process from all ends."""
    rng = np.random.default_rng(4)
    kept = np.array([0.0, 1.0, 3.0, 3.5, 9.0])
    times, correlation_s = np.sort(rng.uniform(0.0, 9.0, 30)), 2.5

    def kernel(a, b):
        return np.exp(-np.abs(a[:, None] - b[None]) / correlation_s)

    weights, left = _bridge(times, kept, correlation_s)
    expected = np.linalg.solve(kernel(kept, kept), kernel(kept, times)).T
    np.testing.assert_allclose(weights.toarray(), expected, atol=1e-9)
    np.testing.assert_allclose(left, 1.0 - (expected * kernel(times, kept)).sum(axis=1), atol=1e-9)


def test_the_determinant_of_field_and_drift_is_that_of_their_dense_matrix():
    nodes = make_nodes(GRID, two_rooms(), 0.8, 10_000)
    times = np.array([0.2, 0.7, 1.1, 5.0])
    points = np.tile([1.0, 1.0], (4, 1))
    readings = RssReadings(points, times, np.full(4, -60.0), np.zeros(4, dtype=np.int64))
    nothing = Coefficients(np.zeros(1), np.ones(1))
    problem = Problem(
        FloorField(nodes), readings, np.ones((4, 1)), nothing, np.zeros(4), Receiver(), np.zeros(4)
    )
    np.testing.assert_array_equal(problem.drift_times_s(), [0.0, 1.0, 5.0])
    prior = problem.prior(Hyperparameters(2.0, 3.0, 0.7, 4.0, np.array([2.0])))
    sign, logarithm = np.linalg.slogdet(prior.matrix.toarray())
    assert sign == 1.0
    assert prior.log_determinant == pytest.approx(logarithm, rel=1e-9)
    covariance = np.linalg.inv(prior.matrix.toarray())
    np.testing.assert_allclose(np.diag(covariance)[: len(nodes)], 9.0, rtol=1e-6)
    np.testing.assert_allclose(np.diag(covariance)[len(nodes) :], 0.49, rtol=1e-6)
    observation = problem.observation().toarray()
    expected = np.zeros_like(observation)
    expected[:, : len(nodes)] = nodes.weights(points).toarray()
    expected[range(4), len(nodes) + np.array([0, 0, 1, 2])] = 1.0
    np.testing.assert_array_equal(observation, expected)
