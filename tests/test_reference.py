# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The reference of accuracy against code that shares nothing with it, and what must not fool it."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
import yaml
from benchmark_scripts import script
from scanned_rooms import PAPER_LOOP, scanned_room

from slarm_graph.app.world_accuracy import accuracy_metrics, accuracy_on
from slarm_graph.config import MappingConfig, RadioConfig, RecoveryConfig
from slarm_graph.eval.metrics import metrics_json
from slarm_graph.eval.radio_accuracy import radio_accuracy
from slarm_graph.files.coverage import write_coverage
from slarm_graph.files.worlds import load_world, world_from_yaml
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.files import write_radio_npz
from slarm_graph.radio.radio_map import radio_map, theoretical_radio_map
from slarm_graph.recovery.recover import recover_scans, with_sizes_of
from slarm_graph.truth_map import truth_map

independent = script("independent_accuracy")

CONFIG = RadioConfig()


def room(**changes):
    """The paper's room as a mapping, its inner wall thinner or everything inside moved."""
    text = (resources.files("slarm_graph") / "worlds" / "paper_room.yaml").read_text("utf-8")
    world = yaml.safe_load(text)
    world["walls"][0]["thickness_m"] = changes.get("thickness_m", 0.5)
    for thing in (*world["walls"], *world["boxes"]):
        thing["center_m"] = [
            thing["center_m"][0] + changes.get("x_m", 0.0),
            thing["center_m"][1] + changes.get("y_m", 0.0),
        ]
    return world


def cluttered():
    text = (resources.files("slarm_graph") / "worlds" / "cluttered.yaml").read_text("utf-8")
    return yaml.safe_load(text)


def something_like(world, resolution_m):
    """A recovered map with errors of every kind: lost, false, blocked and clear for the other."""
    rng = np.random.default_rng(7)
    truth = truth_map(world, resolution_m)
    reference = theoretical_radio_map(world, truth.geometry, CONFIG)
    called = truth.reachable ^ (rng.random(truth.reachable.shape) < 0.05)
    states = np.where(called, CellState.ACCESSIBLE, CellState.OBSTACLE).astype(np.uint8)
    heights = np.where(called, 0.0, np.inf).astype(np.float32)
    geographic = GeographicMap(
        truth.geometry, states, heights, "x", Coverage(called, called, called)
    )
    # Not too near the tolerance: files hold single precision.
    noise_db = rng.choice([-1.5, -0.7, 0.0, 0.6, 1.3], reference.path_loss_db.shape)
    noise_db = noise_db.astype(np.float32)
    return geographic, replace(reference, path_loss_db=reference.path_loss_db + noise_db)


WORLDS = {
    "room": room(),
    "cluttered": cluttered(),
    "thin walls": room(thickness_m=0.04),
    "off the lattice": room(x_m=0.073, y_m=0.041),
}


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("resolution_m", [0.02, 0.05, 0.1, 0.25])
def test_accuracy_agrees_with_an_independent_script(name, resolution_m, tmp_path):
    mapping = WORLDS[name]
    world = world_from_yaml(yaml.safe_dump(mapping))
    geographic, radio = something_like(world, resolution_m)
    write_coverage(tmp_path / "coverage.npz", geographic)
    write_radio_npz(tmp_path / "radio_map.npz", radio)
    theirs = json.loads(metrics_json(accuracy_metrics(world, geographic, radio, CONFIG)))
    mine = independent.accuracies(tmp_path, mapping)
    assert 0.3 < theirs["accuracy"]["value"] < 0.95
    assert np.mean(mine) == pytest.approx(theirs["accuracy"]["value"], abs=1e-6)


@pytest.mark.parametrize("resolution_m", [0.02, 0.05, 0.25])
def test_a_correct_map_is_right_however_thin_or_odd_the_walls(resolution_m):
    """Half a point is what walls off the lattice, or of 4 cm, may cost."""
    scores = {}
    for name in ("room", "thin walls", "off the lattice"):
        world = world_from_yaml(yaml.safe_dump(WORLDS[name]))
        scans, trajectory = scanned_room(0.01, 0.0, world, PAPER_LOOP)
        geometry = GridGeometry.covering(*world.extent_m(), resolution_m)
        recovery = with_sizes_of(world, RecoveryConfig())
        geographic = recover_scans(scans, trajectory, MappingConfig(), recovery, geometry=geometry)
        radio = radio_map(geographic, world.access_points, CONFIG)
        scores[name] = accuracy_on(world, geographic, radio, CONFIG, resolution_m).accuracy
    assert min(scores.values()) > scores["room"] - 0.005, scores
    assert scores["room"] > 0.985


def two_access_points():
    mapping = room()
    mapping["access_points"].append({"name": "other", "x_m": -4.9, "y_m": -3.4, "z_m": 2.5})
    return world_from_yaml(yaml.safe_dump(mapping))


def perfect(world, resolution_m=0.1):
    truth = truth_map(world, resolution_m)
    reference = theoretical_radio_map(world, truth.geometry, CONFIG)
    called = truth.reachable
    states = np.where(called, CellState.ACCESSIBLE, CellState.OBSTACLE).astype(np.uint8)
    layers = Coverage(called, called, called)
    heights = np.zeros(states.shape, dtype=np.float32)
    return called, reference, GeographicMap(truth.geometry, states, heights, "truth", layers)


def test_every_access_point_is_judged():
    called, reference, geographic = perfect(two_access_points())
    wrong = reference.path_loss_db.copy()
    wrong[1] += 30.0
    score = radio_accuracy(called, reference, geographic, replace(reference, path_loss_db=wrong))
    assert [link.accuracy for link in score.links] == [1.0, 0.0]
    assert (score.accuracy, score.worst.accuracy, score.worst.access_point) == (0.5, 0.0, "other")
    told = {m.name: m for m in score.metrics()}
    assert told["accuracy_worst_ap"].value == 0.0
    assert "ap 1.0000, other 0.0000" in told["accuracy_worst_ap"].note
    assert score.gain_mae_db == pytest.approx(15.0, abs=1e-5)
    assert score.gain_rmse_db == pytest.approx(30.0 / np.sqrt(2.0), abs=1e-5)


def test_agreement_and_brier_count_the_cells_accessible_in_both():
    """Neither cells that the map lost nor unknown links may raise them."""
    called, reference, geographic = perfect(load_world("paper_room"))
    lost = geographic.states.copy()
    rows = np.arange(lost.shape[0]) < lost.shape[0] // 2
    lost[rows] = CellState.OBSTACLE
    both = called & ~rows[:, None]
    flipped = ~reference.line_of_sight
    score = radio_accuracy(
        called,
        reference,
        replace(geographic, states=lost),
        replace(reference, line_of_sight=np.where(both, reference.line_of_sight, flipped)),
    )
    assert score.los_agreement == 1.0
    assert score.los_brier == 0.0
    half = replace(reference, los_probability=np.full(flipped.shape, 0.5, np.float32))
    assert radio_accuracy(called, reference, geographic, half).los_brier == 0.25
    unsure = replace(reference, los_unknown=np.ones_like(flipped))
    unknown = radio_accuracy(called, reference, geographic, unsure)
    assert (unknown.los_agreement, unknown.links[0].los_unknown) == (0.0, 1.0)


def test_only_an_area_that_was_to_be_explored_counts():
    world = load_world("paper_room")
    area = (-5.0, 5.0, -3.5, -1.8)
    _, reference, geographic = perfect(world)
    y = geographic.geometry.centers()[..., 1]
    states = np.where(y < -1.8, geographic.states, CellState.OBSTACLE).astype(np.uint8)
    south = replace(geographic, states=states)
    whole = accuracy_on(world, south, reference, CONFIG, 0.1)
    there = accuracy_on(world, south, reference, CONFIG, 0.1, area)
    assert whole.accuracy < 0.5
    assert (there.accuracy, there.iou, there.coverage_observed) == (1.0, 1.0, 1.0)


def test_links_past_unseen_cells_are_unknown():
    """An obstacle decides; an unseen pocket at the border of the known floor does not."""
    states = np.full((40, 60), CellState.ACCESSIBLE, dtype=np.uint8)
    states[10:30, 25:30] = CellState.UNKNOWN
    layers = Coverage(states == 1, states == 1, states == 1)
    geometry = GridGeometry(0.0, 0.0, 0.1, 40, 60)
    heights = np.zeros(states.shape, dtype=np.float32)
    geographic = GeographicMap(geometry, states, heights, "infinite", layers)
    ap = replace(load_world("paper_room").access_points[0], x_m=1.0, y_m=2.0)
    radio = radio_map(geographic, [ap], CONFIG)
    assert radio.sight_unknown[0, 20, 50]
    assert not radio.line_of_sight[0, 20, 50]
    assert radio.line_of_sight[0, 20, 10]
    assert not radio.sight_unknown[0, 20, 10]
    # A wall around the pocket hides the same cells, and then nothing is unknown.
    walled = states.copy()
    walled[9:31, 24:31] = CellState.OBSTACLE
    walled[10:30, 25:30] = CellState.UNKNOWN
    tall = np.where(walled == CellState.OBSTACLE, np.inf, 0.0).astype(np.float32)
    closed = radio_map(replace(geographic, states=walled, heights_m=tall), [ap], CONFIG)
    assert not closed.sight_unknown.any()
    assert not closed.line_of_sight[0, 20, 50]
