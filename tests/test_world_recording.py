# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scripted drives: repeatable sources, tours that reach everything and touch nothing."""

from __future__ import annotations

from itertools import repeat
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial import cKDTree

from slarm_graph.config import LidarConfig, SimulationConfig, SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import (
    is_world_file,
    load_world,
    save_world,
    shipped_worlds,
    world_from_yaml,
)
from slarm_graph.frontends.recordings.convert import convert
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.frontends.simulation.tour import tour_waypoints_m
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.truth_map import truth_map
from slarm_graph.world import DriveCommand


def test_a_source_can_be_read_again() -> None:
    source = SourceFromWorld(
        load_world("paper_room"), seed=3, script=lambda _world: repeat(DriveCommand(0.5, 0.0), 20)
    )
    first = list(source)
    truth = source.truth()
    again = list(source)
    assert len(first) == len(again) == len(truth) == 21
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.scan.ranges_m, two.scan.ranges_m)
        assert one.odom_from_robot == two.odom_from_robot
    np.testing.assert_array_equal(truth.poses, source.truth().poses)
    assert [s.stamp_ns for s in source.scan_statuses()] == [r.stamp_ns for r in first]
    assert not any(s.reason for s in source.scan_statuses())


def test_waypoints_are_reached() -> None:
    points = np.array([[-4.2, -2.8], [-4.2, 0.0], [-4.4, 2.8]])
    source = SourceFromWorld(load_world("paper_room"), script=waypoints(points))
    list(source)
    away, _ = cKDTree(source.truth().poses[:, :2]).query(points)
    assert away.max() < 0.11


def test_truth_belongs_to_the_stamp_of_a_sweeping_laser() -> None:
    config = SimulationConfig(lidar=LidarConfig(sweep_s=0.1))
    script = lambda _world: repeat(DriveCommand(0.5, 0.0), 10)  # noqa: E731
    source = SourceFromWorld(load_world("paper_room"), config, script=script)
    readings = list(source)
    moved = np.diff(source.truth().poses[:, 0])
    assert moved[0] == 0.0
    assert moved[1:] == pytest.approx(0.05, abs=0.01)
    assert readings[1].stamp_ns - readings[0].stamp_ns == 100_000_000


def check_tour(name: str) -> None:
    world = load_world(name)
    source = SourceFromWorld(world, seed=1)
    for _ in source:
        pass
    assert source.info().notices == (), "the robot touches nothing"
    truth = truth_map(world, 0.1)
    cells = truth.geometry.centers()[truth.reachable]
    away, _ = cKDTree(source.truth().poses[:, :2]).query(cells)
    assert np.mean(away < 3.0) > 0.99
    end = source.truth().poses[-1, :2] - [world.start.x, world.start.y]
    assert np.linalg.norm(end) < 0.5


@pytest.mark.parametrize("name", ["paper_room", "office", "cluttered", "dead_ends"])
def test_tours_go_everywhere_and_come_back(name: str) -> None:
    check_tour(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(shipped_worlds()))
def test_every_tour_goes_everywhere_and_comes_back(name: str) -> None:
    check_tour(name)


def test_random_worlds_can_be_toured() -> None:
    for seed in range(5):
        world = random_world(np.random.default_rng(seed))
        assert len(tour_waypoints_m(world, 0.18)) > 5


def test_a_body_that_does_not_fit_is_refused() -> None:
    text = (
        "{name: slot, ceiling_m: 3, boundary_m: [[0,0],[4,0],[4,0.5],[0,0.5]],"
        " start: {x_m: 1, y_m: 0.25}}"
    )
    with pytest.raises(BadInput, match=r"slot: there is no room for a robot of 0.3 m radius"):
        tour_waypoints_m(world_from_yaml(text), 0.3)


def test_a_world_file_is_a_source(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    save_world(load_world("paper_room"), path)
    source = open_source(path, SourceConfig())
    assert isinstance(source, SourceFromWorld)
    assert source.info().description == "simulated drive through paper_room"
    assert next(iter(source)).odom_from_robot is not None


def test_a_world_converts_to_a_recording_with_its_truth(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    save_world(load_world("paper_room"), path)
    assert convert(path, tmp_path / "room.mcap").endswith("with ground truth")
    readings = list(open_source(tmp_path / "room.mcap", SourceConfig()))
    drive = SourceFromWorld(load_world(path))
    for one, other in zip(readings, drive, strict=True):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.scan.ranges_m, other.scan.ranges_m)
    with AnyReader([tmp_path / "room.mcap"]) as bag:
        topics = {c.topic: c.msgcount for c in bag.connections}
    assert topics["/ground_truth"] == topics["/scan"] == len(readings)


def test_other_yaml_files_are_not_worlds(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    (tmp_path / "config.yaml").write_text("seed: 3\n")
    (tmp_path / "broken.yaml").write_text("a: [")
    assert not any(is_world_file(path) for path in tmp_path.iterdir())
