# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A world recorded to a bag, read back and mapped with true poses, has its walls where they are."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.config import LidarConfig, MappingConfig, SimulationConfig, SourceConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.ros_writing import write_readings
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld
from slarm_graph.geometry import Pose2
from slarm_graph.mapping import render
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import WorldMap

CELL_M = 0.05

LASERS = {
    "ahead": LidarConfig(),
    "negative increment": LidarConfig(clockwise=True),
    "rear": LidarConfig(x_m=-0.15, yaw_rad=math.pi, field_of_view_rad=4.7, beams=270),
    "offset and yawed": LidarConfig(x_m=0.1, y_m=-0.05, yaw_rad=0.7),
    "upside down": LidarConfig(x_m=0.1, upside_down=True),
    "upside down, rear, negative": LidarConfig(
        x_m=-0.1, yaw_rad=3.0, upside_down=True, clockwise=True
    ),
    "sweeping": LidarConfig(x_m=0.1, sweep_s=0.08),
}


def distance_to_walls_m(world: WorldMap, points_m: np.ndarray) -> np.ndarray:
    """Distance of points (N, 2) to the nearest side of a solid or of the boundary."""
    nearest = np.full(len(points_m), np.inf)
    for corners in (world.boundary_m, *(solid.corners_m for solid in world.solids)):
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            side = end - start
            share = np.clip((points_m - start) @ side / (side @ side), 0.0, 1.0)
            foot = start + share[:, None] * side
            nearest = np.minimum(nearest, np.linalg.norm(points_m - foot, axis=1))
    return nearest


@pytest.mark.parametrize("laser", LASERS, ids=lambda name: name.replace(" ", "_"))
def test_walls_are_within_half_a_cell(tmp_path: Path, laser: str) -> None:
    world = load_world("paper_room")
    drive = SourceFromWorld(world, SimulationConfig(lidar=LASERS[laser]), seed=1)
    readings = list(drive)[:500]
    path = tmp_path / "world.bag" if "rear" in laser else tmp_path / "world.mcap"
    write_readings(path, readings, upside_down=LASERS[laser].upside_down)
    got = list(open_source(path, SourceConfig()))
    assert [r.stamp_ns for r in got] == [r.stamp_ns for r in readings]
    truth = Trajectory(
        np.array([r.stamp_ns for r in got]), drive.truth().at([r.stamp_ns for r in got])
    )
    grid = render([r.scan for r in got], truth, MappingConfig(resolution_m=CELL_M))
    walls = grid.geometry.centers()[grid.occupied]
    assert len(walls) > 500
    away = distance_to_walls_m(world, walls.reshape(-1, 2))
    assert np.quantile(away, 0.95) <= 0.5 * CELL_M + 1e-3, laser


def test_the_bag_holds_what_its_laser_says(tmp_path: Path) -> None:
    """Upside down in the bag is not upside down in the readings, and never mirrored."""
    world = load_world("paper_room")
    drive = SourceFromWorld(world, SimulationConfig(lidar=LASERS["offset and yawed"]), seed=1)
    readings = list(drive)[:40]
    for name, hanging in (("up.bag", False), ("down.bag", True)):
        write_readings(tmp_path / name, readings, upside_down=hanging)
        for one, other in zip(open_source(tmp_path / name, SourceConfig()), readings, strict=True):
            np.testing.assert_allclose(one.scan.points_m(), other.scan.points_m(), atol=1e-5)
    notices = open_source(tmp_path / "down.bag", SourceConfig()).info().notices
    assert "laser frame laser is mounted upside down (from tf)" in notices


def test_odometry_survives(tmp_path: Path) -> None:
    drive = SourceFromWorld(load_world("paper_room"), seed=2)
    readings = list(drive)[:100]
    path, truth = tmp_path / "a.db3", drive.truth()
    poses = [(s, Pose2(*p)) for s, p in zip(truth.stamps_ns, truth.poses, strict=True)]
    write_readings(path, readings, truth=poses[:100])
    for one, other in zip(open_source(path, SourceConfig()), readings, strict=True):
        step = other.odom_from_robot.between(one.odom_from_robot)
        np.testing.assert_allclose(step.as_array(), 0.0, atol=1e-9)
