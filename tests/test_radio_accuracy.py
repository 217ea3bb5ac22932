# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio accuracy: identities, and maps that must fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.config import RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.eval.radio_accuracy import radio_accuracy
from slarm_graph.eval.radio_scores import LinkAccuracy, RadioAccuracy
from slarm_graph.files.worlds import load_world
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.radio_map import radio_map, theoretical_radio_map

CONFIG = RadioConfig()
WORLD = load_world("paper_room")


def truth(resolution):
    geometry = GridGeometry.covering(*WORLD.extent_m(), resolution)
    reference = theoretical_radio_map(WORLD, geometry, CONFIG)
    x, y = np.moveaxis(geometry.centers(), -1, 0)
    ring = (np.abs(x) > 3.5) | (np.abs(y) > 1.75)
    return reference, np.isfinite(reference.path_loss_db[0]) & ring


def as_map(reference, accessible):
    states = np.where(accessible, CellState.ACCESSIBLE, CellState.OBSTACLE).astype(np.uint8)
    layers = Coverage(accessible, accessible, accessible)
    heights = np.where(accessible, 0.0, np.inf).astype(np.float32)
    return GeographicMap(reference.geometry, states, heights, "truth", layers, 0, WORLD.solids)


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.15, 0.25])
def test_perfect_map_scores_one(resolution):
    reference, accessible = truth(resolution)
    score = radio_accuracy(
        accessible, reference, as_map(reference, accessible), reference, extent_m=WORLD.extent_m()
    )
    assert (score.accuracy, score.iou, score.los_agreement) == (1.0, 1.0, 1.0)
    assert (score.gain_rmse_db, score.gain_mae_db, score.false_accessible) == (0.0, 0.0, 0.0)


def test_recovered_solids_give_the_theoretical_gain():
    reference, accessible = truth(0.1)
    estimate = radio_map(as_map(reference, accessible), WORLD.access_points, CONFIG)
    score = radio_accuracy(accessible, reference, as_map(reference, accessible), estimate)
    assert score.accuracy == 1.0


def test_all_free_map_fails_on_overlap():
    reference, accessible = truth(0.1)
    everything = as_map(reference, np.ones_like(accessible))
    estimate = radio_map(replace(everything, solids=()), WORLD.access_points, CONFIG)
    score = radio_accuracy(accessible, reference, everything, estimate)
    assert score.coverage_accessible == 1.0
    assert score.iou < 0.65
    assert score.false_accessible > 0.35
    assert score.los_agreement < 0.5


def test_accuracy_is_coverage_times_gain_hit():
    rng = np.random.default_rng(1)
    reference, accessible = truth(0.1)
    called = accessible & (rng.random(accessible.shape) < 0.8)
    noisy = replace(
        reference,
        path_loss_db=reference.path_loss_db
        + rng.normal(0, 1, reference.path_loss_db.shape).astype(np.float32),
    )
    score = radio_accuracy(accessible, reference, as_map(reference, called), noisy)
    assert score.accuracy == pytest.approx(score.coverage_accessible * score.gain_hit, rel=1e-14)
    assert 0.65 < score.gain_hit < 0.72
    assert score.gain_rmse_db == pytest.approx(1.0, abs=0.05)
    assert score.gain_mae_db == pytest.approx(np.sqrt(2 / np.pi), abs=0.05)


def test_coarse_map_scored_on_a_fine_lattice():
    fine, accessible = truth(0.05)
    coarse, coarse_accessible = truth(0.25)
    score = radio_accuracy(accessible, fine, as_map(coarse, coarse_accessible), coarse)
    assert 0.9 < score.accuracy < 1.0
    assert score.accuracy == pytest.approx(score.coverage_accessible * score.gain_hit, rel=1e-14)


def test_cells_that_stick_out_count_by_their_area():
    geometry = GridGeometry.covering(0.0, 1.0, 0.0, 0.6, 0.15)
    weights = geometry.share_within(0.0, 1.0, 0.0, 0.6)
    assert weights.shape == (4, 7)
    assert weights.sum() * 0.15**2 == pytest.approx(0.6)
    assert weights[0, 0] == 1.0
    assert weights[0, -1] == pytest.approx(2 / 3)


def test_warns_when_the_tolerance_cannot_tell():
    reference, accessible = truth(0.25)
    score = radio_accuracy(
        accessible, reference, as_map(reference, accessible), reference, tolerance_db=2.0
    )
    assert "cannot tell" in score.warnings[0]
    assert not radio_accuracy(
        accessible, reference, as_map(reference, accessible), reference
    ).warnings
    assert {m.name for m in score.metrics()} >= {"accuracy", "gain_hit", "coverage_visited", "iou"}


def test_empty_reference_is_refused():
    reference, accessible = truth(0.25)
    with pytest.raises(BadInput):
        radio_accuracy(
            np.zeros_like(accessible), reference, as_map(reference, accessible), reference
        )


def unsure(rng, reference):
    """The reference with unknown links, and with chances of line of sight."""
    unknown = rng.random(reference.line_of_sight.shape) < 0.3
    chance = np.where(unknown, 0.0, rng.random(unknown.shape)).astype(np.float32)
    return replace(
        reference, line_of_sight=chance > 0.5, los_probability=chance, los_unknown=unknown
    )


def test_a_map_agrees_with_itself_where_neither_knows():
    reference, accessible = truth(0.25)
    known = unsure(np.random.default_rng(3), reference)
    score = radio_accuracy(accessible, known, as_map(known, accessible), known)
    assert (score.accuracy, score.los_agreement, score.los_brier) == (1.0, 1.0, 0.0)
    unknown = known.los_unknown[0][accessible].mean()
    assert score.links[0].los_unknown == pytest.approx(unknown)
    told = {m.name: m for m in score.metrics()}
    assert told["los_unknown"].value == pytest.approx(unknown)
    assert told["los_agreement"].note.startswith(f"{unknown:.2%} unknown to the reference")


def test_metrics_of_several_access_points_are_means_with_each_of_them_told():
    """Only gain errors are squared, and the worst is of the least accuracy."""
    shares = np.array([[0.9, 0.95, 0.8, 0.1, 0.0, 0.02, 3.0, 2.0],
                       [0.5, 0.75, 0.6, 0.3, 0.2, 0.04, 4.0, 3.0]])  # fmt: skip
    score = RadioAccuracy(
        (LinkAccuracy("hall", *shares[0]), LinkAccuracy("yard", *shares[1])),
        0.91, 0.92, 0.93, 0.94, 0.05, 0.87, tolerance_db=1.5, expansion_radius_m=0.25,
        smallest_gap_db=1.4,
    )  # fmt: skip
    assert score.warnings == (
        "a tolerance of 1.5 dB cannot tell blocked from clear links, which differ by as little as"
        " 1.40 dB here",
    )
    assert replace(score, smallest_gap_db=1.6).warnings == ()
    told = {m.name: (pytest.approx(m.value), m.note) for m in score.metrics()}
    note = "|gain error| <= 1.5 dB; R_e = 0.25 m; mean of 2 access points; " + score.warnings[0]
    assert told == {
        "accuracy": (0.7, note),
        "accuracy_worst_ap": (0.5, "of hall 0.9000, yard 0.5000"),
        "coverage_observed": (0.92, ""),
        "coverage_visited": (0.93, ""),
        "coverage_footprint": (0.94, ""),
        "gain_hit": (0.85, ""),
        "coverage_accessible": (0.91, ""),
        "false_accessible": (0.05, ""),
        "iou": (0.87, ""),
        "los_agreement": (0.7, "10.00% unknown to the reference itself; agrees where both are"),
        "los_unknown": (0.2, ""),
        "los_brier": (0.03, ""),
        "gain_rmse_db": (np.sqrt((9.0 + 16.0) / 2), ""),
        "gain_mae_db": (2.5, ""),
    }


def test_line_of_sight_agrees_by_three_classes():
    """Second implementation: cell by cell, in words."""
    reference, accessible = truth(0.25)
    rng = np.random.default_rng(4)
    known, other = unsure(rng, reference), unsure(rng, reference)

    def word(radio, row, col):
        if radio.los_unknown[0, row, col]:
            return "unknown"
        return "clear" if radio.line_of_sight[0, row, col] else "blocked"

    cells = np.argwhere(accessible)
    same = np.mean([word(known, *cell) == word(other, *cell) for cell in cells])
    score = radio_accuracy(accessible, known, as_map(known, accessible), other)
    assert score.los_agreement == pytest.approx(same)
    assert 0.3 < same < 0.6
