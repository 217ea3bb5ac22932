# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A mounting or a sign that scans and odometry disagree about throughout is found and told."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.config import LidarConfig, SimulationConfig, SourceConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.odometry_agreement import disagreement
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading


@pytest.fixture(scope="module")
def readings() -> list[Reading]:
    """A drive through the paper's room with good odometry."""
    lidar = LidarConfig(x_m=0.1, beams=180)
    source = SourceFromWorld(load_world("paper_room"), SimulationConfig(lidar=lidar), seed=0)
    return list(source)[:700]


def told(readings: list[Reading]) -> str:
    poses = np.array([r.odom_from_robot.as_array() for r in readings if r.odom_from_robot])
    return disagreement(lambda k: readings[k].scan, poses, np.ones(len(poses), bool))


def mounted(readings: list[Reading], yaw_rad: float) -> list[Reading]:
    """Readings whose transform says that the laser is turned by less than it is."""
    wrong = [r.scan.robot_from_laser @ Pose2(0.0, 0.0, -yaw_rad) for r in readings]
    return [
        replace(r, scan=replace(r.scan, robot_from_laser=pose))
        for r, pose in zip(readings, wrong, strict=True)
    ]


def test_nothing_is_said_when_they_agree(readings: list[Reading]) -> None:
    assert told(readings) == ""


@pytest.mark.parametrize("yaw_deg", [180.0, 90.0, -45.0, 12.0, -8.0])
def test_the_mounting_that_explains_it_is_named(readings: list[Reading], yaw_deg: float) -> None:
    text = told(mounted(readings, math.radians(yaw_deg)))
    found = re.search(r"larger by ([-+]\d+) deg", text)
    assert found is not None, text
    off = (float(found[1]) - yaw_deg + 180.0) % 360.0 - 180.0
    assert abs(off) < 3.0


def test_a_laser_upside_down_that_is_not_told_so(readings: list[Reading]) -> None:
    mirrored = [
        replace(
            r,
            scan=replace(
                r.scan,
                angle_min_rad=-r.scan.angle_min_rad,
                angle_increment_rad=-r.scan.angle_increment_rad,
            ),
        )
        for r in readings
    ]
    assert "turn opposite ways" in told(mirrored)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_odometry_in_another_unit(readings: list[Reading], scale: float) -> None:
    stretched = [
        replace(r, odom_from_robot=Pose2(scale * o.x, scale * o.y, o.theta))
        for r in readings
        if (o := r.odom_from_robot)
    ]
    assert f"{scale:.2g} times as long" in told(stretched)


def test_the_case_of_a_laser_that_looks_to_the_rear(shared_data: Path) -> None:
    path = shared_data / "cases/mount_180/rec.bag"
    found = [f.what for f in check(path).findings if f.severity == "warning"]
    assert any("180 deg apart" in what for what in found)
    source = open_source(path, SourceConfig())
    list(source)
    assert sum("180 deg apart" in notice for notice in source.info().notices) == 1
    list(source)
    assert sum("180 deg apart" in notice for notice in source.info().notices) == 1


@pytest.mark.parametrize(
    "name",
    ["cases/control/rec", "benchmark/mit-csail", "robot_bags/jan17_expt08", "benchmark/fr079"],
)
def test_real_robots_agree_with_themselves(shared_data: Path, name: str) -> None:
    source = open_source(shared_data / f"{name}.bag", SourceConfig())
    list(source)
    assert not any("scans and odometry" in notice for notice in source.info().notices)
