# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The fit of one access point's field: its likelihood by dense algebra, its bounds, its noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured import factor, fit
from slarm_graph.radio.measured.fit import (
    Hyperparameters,
    Problem,
    _fit_degrees_of_freedom,
    _initial_hyperparameters,
    _maximise_evidence,
    fit_field,
    log_student_t,
)
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.posterior import Coefficients
from slarm_graph.radio.measured.priors import FloorField, field_correlation
from slarm_graph.radio.measured.readings import Receiver, RssReadings, gaussian_equivalent

GRID = GridGeometry(0.0, 0.0, 0.1, 40, 60)
CENTRE = np.log([3.0, 5.0, 2.0, 5.0, 4.0, 4.0])
"""Typical range, field, drift, its time, and the noise of two classes."""
DOUBT = np.array([0.8, 0.7, 0.7, 1.0, 0.7, 0.7])


def problem_of(count: int = 40, seed: int = 0, sd_db: float = 3.0) -> Problem:
    """Readings of two classes, the second noisier, on a floor without walls."""
    rng = np.random.default_rng(seed)
    nodes = make_nodes(GRID, np.ones(GRID.shape, dtype=bool), 0.8, 10_000)
    points = rng.uniform([0.1, 0.1], [5.9, 3.9], (count, 2))
    kind = np.arange(count) % 2
    rss = -60.0 + 4.0 * np.sin(points[:, 0]) + sd_db * (1 + kind) * rng.normal(size=count)
    readings = RssReadings(points, np.arange(count) * 0.4, rss, kind, classes=2)
    design = np.column_stack([np.ones(count), points[:, 1]])
    coefficients = Coefficients(np.array([-60.0, 0.0]), np.array([10.0, 1.0]))
    nothing = np.zeros(count)
    return Problem(FloorField(nodes), readings, design, coefficients, nothing, Receiver(), nothing)


def cost_of(
    problem: Problem, hyper: Hyperparameters, vector: Floats, values: Floats, weights: Floats
) -> float:
    """Second implementation: the readings' whole covariance, and the prior of the vector."""
    tried = hyper.moved(vector)
    state = np.linalg.inv(problem.prior(tried).matrix.toarray())
    observation, b = problem.observation().toarray(), problem.design
    noise = tried.noise_sd_db[problem.readings.noise_class] ** 2 / weights
    total = (
        observation @ state @ observation.T
        + (b * problem.coefficients.sd**2) @ b.T
        + np.diag(noise)
    )
    off = values - b @ problem.coefficients.mean
    likelihood = stats.multivariate_normal(np.zeros(len(off)), total).logpdf(off)
    return float(-likelihood + 0.5 * np.sum(((vector - CENTRE) / DOUBT) ** 2))


@pytest.mark.parametrize("seed", range(2))
def test_the_search_ends_where_no_step_is_likelier(seed: int) -> None:
    problem = problem_of(seed=seed)
    hyper = _initial_hyperparameters(problem)
    np.testing.assert_allclose(hyper.vector(), CENTRE)
    expected = np.full(40, -60.0)
    values, weights = gaussian_equivalent(
        problem.readings.rss_dbm, expected, problem.noise_variance(hyper), Receiver(), 8.0
    )
    found = _maximise_evidence(problem, hyper, expected, weights)

    def cost(vector: Floats) -> float:
        return cost_of(problem, hyper, vector, values, weights)

    best = cost(found.vector())
    assert best < cost(CENTRE)
    for step in 0.2 * np.eye(6):
        # Steps that gain less than a fiftieth of a nat end it.
        assert best < min(cost(found.vector() + step), cost(found.vector() - step)) + 0.1


def test_the_search_stays_within_three_sigmas(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def spy(*args: Any, **how: Any) -> Any:
        asked.append(how["bounds"])
        return minimize(*args, **how)

    minimize = fit.minimize
    monkeypatch.setattr(fit, "minimize", spy)
    found = fit_field(problem_of())
    for bounds in asked:
        np.testing.assert_allclose(bounds, np.stack([CENTRE - 3 * DOUBT, CENTRE + 3 * DOUBT], 1))
    assert (np.abs(found.hyper.vector() - CENTRE) <= 3.0 * DOUBT + 1e-9).all()
    assert found.readings == 40


def test_a_search_knows_its_slopes_ends_soon_and_orders_rows_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Slopes that were off made line searches fail, after twenty steps each."""
    ended: list[Any] = []
    ordered: list[int] = []
    fill_reducing = factor._fill_reducing

    def spy(*args: Any, **how: Any) -> Any:
        slopes_are_right(*args)
        ended.append(minimize(*args, **how))
        return ended[-1]

    def order_spy(matrix: Any) -> Any:
        ordered.append(matrix.shape[0])
        return fill_reducing(matrix)

    def slopes_are_right(cost: Any, start: Floats) -> None:
        for k, step in enumerate(1e-3 * np.eye(len(start))):
            slope = (cost(start + step)[0] - cost(start - step)[0]) / 2e-3
            assert cost(start)[1][k] == pytest.approx(slope, rel=1e-2, abs=1e-2)

    monkeypatch.setattr(fit, "minimize", spy)
    monkeypatch.setattr(factor, "_fill_reducing", order_spy)
    problem = problem_of(300)
    fit_field(problem)
    assert [bool(found.success or found.nit == 12) for found in ended] == [True, True]
    assert max(found.nfev for found in ended) <= 20
    nodes = len(problem.floor.nodes)
    assert ordered == [nodes, nodes + len(problem.drift_times_s())]


def test_the_classes_noise_is_told_apart() -> None:
    """The second class has twice the noise; a search finds either to a third."""
    found = fit_field(problem_of(300, sd_db=3.0)).hyper
    assert found.noise_sd_db == pytest.approx([3.0, 6.0], rel=0.33)


def test_without_a_search_hyperparameters_are_taken_as_they_are() -> None:
    hyper = Hyperparameters(2.0, 3.0, 1.0, 4.0, np.array([1.0, 2.0]), 5.0)
    assert fit_field(problem_of(), hyper, search=False).hyper is hyper


def test_hyperparameters_are_their_logarithms() -> None:
    hyper = Hyperparameters(2.0, 3.0, 0.7, 4.0, np.array([1.0, 2.0, 5.0]), 5.0)
    np.testing.assert_allclose(np.exp(hyper.vector()), [2.0, 3.0, 0.7, 4.0, 1.0, 2.0, 5.0])
    again = hyper.moved(hyper.vector())
    assert replace(again, noise_sd_db=hyper.noise_sd_db) == replace(
        hyper, range_m=again.range_m, field_sd_db=again.field_sd_db,
        drift_sd_db=again.drift_sd_db, drift_s=again.drift_s,
    )  # fmt: skip
    np.testing.assert_allclose(again.vector(), hyper.vector())


def test_noise_grows_with_what_an_uncertain_position_makes_of_field_and_mean() -> None:
    """By hand: the class's own, the doubt, what the field may change on the way, the slope."""
    problem = problem_of(4)
    hyper = Hyperparameters(2.0, 3.0, 1.0, 4.0, np.array([1.5, 2.5]))
    own = np.array([1.5, 2.5, 1.5, 2.5]) ** 2
    np.testing.assert_allclose(problem.noise_variance(hyper), own)
    sd_m, slope, doubt = np.array([0.0, 0.1, 0.5, 2.0]), np.arange(4.0), np.arange(4.0) / 7
    problem.readings = replace(problem.readings, position_sd_m=sd_m)
    problem.mean_slope_db_m, problem.map_variance_db2 = slope, doubt
    lost = 2.0 * 9.0 * (1.0 - field_correlation(sd_m, 2.0))
    np.testing.assert_allclose(
        problem.noise_variance(hyper), own + doubt + lost + (slope * sd_m) ** 2
    )


@pytest.mark.parametrize("freedom", [3.0, 8.0, 100.0])
def test_students_density_is_that_of_another_program(freedom: float) -> None:
    scaled = np.linspace(-6.0, 6.0, 25)
    np.testing.assert_allclose(log_student_t(scaled, freedom), stats.t(freedom).logpdf(scaled))


@pytest.mark.parametrize(("true", "low", "high"), [(3.0, 3.0, 4.0), (100.0, 30.0, 100.0)])
def test_heavy_tails_are_told_from_gaussian_noise(true: float, low: float, high: float) -> None:
    """Of quantiles, so that no draw decides; what was not heard has no say."""
    problem = problem_of(400)
    noise = 2.0 * stats.t(true).ppf((np.arange(400) + 0.5) / 400)
    rss = -60.0 + noise
    rss[::7] = np.nan
    problem.readings = replace(problem.readings, rss_dbm=rss)
    hyper = Hyperparameters(2.0, 3.0, 1.0, 4.0, np.array([2.0, 2.0]))
    assert low <= _fit_degrees_of_freedom(problem, hyper, np.full(400, -60.0)) <= high


def test_a_new_readings_spread_is_that_of_its_noise_and_the_drift() -> None:
    hyper = Hyperparameters(2.0, 3.0, 1.5, 4.0, np.array([2.0, 9.0]), 5.0)
    found = fit_field(problem_of(), hyper, search=False)
    expected = np.sqrt((2.0 * stats.t(5.0).std()) ** 2 + 1.5**2)
    assert found.reading_sd_db() == pytest.approx(expected)


def test_a_receiver_hears_everything_unless_told_otherwise() -> None:
    """By default silence is a lost packet, which says nothing; no reading is at the top."""
    rss, expected = np.array([np.nan, -20.0]), np.array([-300.0, -20.0])
    values, weights = gaussian_equivalent(rss, expected, np.full(2, 16.0), Receiver(), 5.0)
    assert weights[0] < 1e-5
    assert values[1] == -20.0
    assert weights[1] == pytest.approx(1.2)
    assert (Receiver().threshold_dbm, Receiver().saturation_dbm) == (-np.inf, np.inf)


def test_some_readings_keep_all_that_is_known_of_them() -> None:
    rss = np.array([-60.0, np.nan, -70.0, -80.0, np.nan])
    every = np.arange(5.0)
    points = np.arange(10.0).reshape(5, 2)
    readings = RssReadings(points, every, rss, np.arange(5), every / 10, every / 100, classes=5)
    assert readings.heard.tolist() == [True, False, True, True, False]
    for which in (np.array([3, 0]), np.array([True, False, False, True, True])):
        found = readings.only(which)
        order = np.arange(5)[which]
        np.testing.assert_array_equal(found.points_m[:, 0], 2.0 * order)
        np.testing.assert_array_equal(found.times_s, order)
        np.testing.assert_array_equal(found.rss_dbm, rss[which])
        np.testing.assert_array_equal(found.noise_class, order)
        assert found.headings_rad is not None
        assert found.position_sd_m is not None
        np.testing.assert_array_equal(found.headings_rad, order / 10)
        np.testing.assert_array_equal(found.position_sd_m, order / 100)
        assert (len(found), found.classes) == (len(order), 5)
