# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Path loss against the standard's own tables, as the package tr3gpp holds them."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from tr3gpp import tr38901

from slarm_graph.errors import BadInput
from slarm_graph.radio.path_loss import (
    SCENARIOS,
    Clutter,
    los_probability,
    los_probability_office,
    outside_range,
    path_loss_db,
    shadow_sigma_db,
    smallest_blocking_gap_db,
)

DISTANCES_M = np.geomspace(1.0, 150.0, 97)
FREQUENCIES_HZ = (0.5e9, 2.4e9, 3.5e9, 28e9, 100e9)
TABLED = ["InF-SL", "InF-DL", "InF-SH", "InF-DH", "InH"]


def _row(scenario: str, condition: str):
    return tr38901.section("7.4").pathloss(scenario=scenario, condition=condition, variant=None)


def _law(formula: str):
    """Numbers in the first linear formula of a LaTeX table entry."""
    text = formula.replace(" ", "")
    number = r"([\d.]+)"
    log_d = re.search(number + r"\\log_\{10\}\(d_\{3D\}\)", text)
    log_f = re.search(number + r"\\log_\{10\}\(f_c\)", text)
    rest = re.sub(number + r"\\log_\{10\}\([^)]*\)", "", text)
    constant = re.search(r"[=+]" + number + r"(?![\d.]*\\log)", rest)
    assert log_d and log_f and constant, formula
    return float(constant[1]), float(log_d[1]), float(log_f[1])


def _oracle_row(scenario: str, condition: str):
    family = "InF" if scenario.startswith("InF") and condition == "LOS" else scenario
    return _row("InH-Office" if family == "InH" else family, condition)


def _oracle_db(scenario: str, condition: str, distance_m: float, frequency_hz: float) -> float:
    rows = [_oracle_row(scenario, "LOS")]
    if condition == "NLOS":
        rows.append(_oracle_row(scenario, "NLOS"))
        if scenario == "InF-DL":
            rows.append(_oracle_row("InF-SL", "NLOS"))
    values = []
    for row in rows:
        part = row.formula.split(";")[-1] if "'" in row.formula else row.formula.split(";")[0]
        a, b, c = _law(part)
        values.append(a + b * math.log10(distance_m) + c * math.log10(frequency_hz / 1e9))
    return max(values)


@pytest.mark.parametrize("scenario", TABLED)
@pytest.mark.parametrize("condition", ["LOS", "NLOS"])
def test_equals_the_tables_of_the_standard(scenario, condition):
    for frequency_hz in FREQUENCIES_HZ:
        ours = path_loss_db(DISTANCES_M, frequency_hz, condition == "LOS", scenario)
        oracle = [_oracle_db(scenario, condition, d, frequency_hz) for d in DISTANCES_M]
        np.testing.assert_allclose(ours, oracle, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scenario", TABLED)
def test_shadow_sigma_equals_the_tables(scenario):
    for condition in ("LOS", "NLOS"):
        row = _oracle_row(scenario, condition)
        (entry,) = row.shadow_fading_std_db
        assert shadow_sigma_db(condition == "LOS", scenario) == entry.value_db


def test_hand_worked_values_of_the_paper_scenario():
    """At 10 m and 1 GHz a law leaves the intercept plus one slope."""
    assert path_loss_db(10.0, 1e9, True, "InF-SH") == pytest.approx(31.84 + 21.5, abs=1e-12)
    assert path_loss_db(10.0, 1e9, False, "InF-SH") == pytest.approx(32.40 + 23.0, abs=1e-12)


def test_wrong_copies_in_circulation_are_not_ours():
    d, f = 20.0, 3.5e9
    assert shadow_sigma_db(True, "InF-SH") != 4.0
    assert path_loss_db(d, f, False, "InF-SH") != path_loss_db(d, f, False, "InF-DH")
    without_sl = 18.60 + 35.7 * math.log10(3.0) + 20.0 * math.log10(3.5)
    assert path_loss_db(3.0, f, False, "InF-DL") > without_sl + 1.0


def test_blocking_never_lowers_the_loss():
    for name in SCENARIOS:
        for frequency_hz in FREQUENCIES_HZ:
            assert smallest_blocking_gap_db(frequency_hz, name, DISTANCES_M) >= 0.0


def test_held_below_the_shortest_distance_and_extrapolated_beyond():
    near = path_loss_db([0.0, 0.5, 1.0], 3.5e9, True, "InF-SH")
    assert np.ptp(near) == 0.0
    assert path_loss_db(700.0, 3.5e9, True, "InF-SH") > path_loss_db(600.0, 3.5e9, True, "InF-SH")
    assert outside_range([0.5, 1.0, 600.0, 601.0], "InF-SH").tolist() == [True, False, False, True]


@pytest.mark.parametrize("frequency_hz", [0.0, -1.0, 0.4e9, 101e9, math.nan])
def test_frequency_outside_the_standard_is_refused(frequency_hz):
    with pytest.raises(BadInput, match="GHz"):
        path_loss_db(10.0, frequency_hz, True, "InF-SH")


def test_free_space_has_no_limits():
    assert path_loss_db(10.0, 433e6, False, "free-space") == path_loss_db(
        10.0, 433e6, True, "free-space"
    )


def test_unknown_scenario_names_the_nearest():
    with pytest.raises(BadInput, match="did you mean InF-SH"):
        path_loss_db(10.0, 3.5e9, True, "inf-SH")


def test_line_of_sight_probability_of_halls():
    sparse = Clutter(size_m=10.0, density=0.2, height_m=2.0)
    d = np.array([0.0, 10.0, 30.0])
    low = los_probability(d, "InF-SL", sparse, base_height_m=1.5, antenna_height_m=1.0)
    np.testing.assert_allclose(low, 0.8 ** (d / 10.0))
    high = los_probability(d, "InF-SH", sparse, base_height_m=8.0, antenna_height_m=1.0)
    np.testing.assert_allclose(high, 0.8 ** (d / 70.0))
    assert los_probability(d, "InF-HH", sparse, base_height_m=8, antenna_height_m=1).all()
    with pytest.raises(BadInput):
        los_probability(d, "InH", sparse, base_height_m=8, antenna_height_m=1)


def test_line_of_sight_probability_of_offices():
    open_office = los_probability_office([3.0, 49.0, 60.0], is_open=True)
    np.testing.assert_allclose(
        open_office, [1.0, math.exp(-44 / 70.8), 0.54 * math.exp(-11 / 211.7)]
    )
    mixed = los_probability_office([1.0, 4.0, 6.5], is_open=False)
    np.testing.assert_allclose(mixed, [1.0, math.exp(-2.8 / 4.7), 0.32])
