# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Real recordings of every kind: all forms of one log agree, and nothing is lost on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.eval.relations import read_relations
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geometry import between, compose
from slarm_graph.readings import Source
from slarm_graph.trajectory import Trajectory


def odometry(source: Source, *, at_laser: bool = False) -> Trajectory:
    got = [r for r in source if r.odom_from_robot is not None]
    poses = np.array([r.odom_from_robot.as_array() for r in got])
    if at_laser:
        poses = compose(poses, [r.scan.robot_from_laser.as_array() for r in got])
    return Trajectory(np.array([r.stamp_ns for r in got]), poses)


def assert_same(one: Trajectory, other: Trajectory) -> None:
    """To 1 us and 1 um."""
    assert len(one) == len(other)
    assert np.abs(one.stamps_ns - other.stamps_ns).max() <= 1000
    assert np.abs(one.poses[:, :2] - other.poses[:, :2]).max() <= 1e-6
    assert np.abs(between(one.poses, other.poses)[:, 2]).max() <= 1e-6


def test_three_forms_of_mit_csail_agree(shared_data: Path) -> None:
    forms = ["benchmark/mit-csail.bag", "ros2/mit-csail_db3", "benchmark/mit-csail.clf.gz"]
    first, *others = (odometry(open_source(shared_data / f, SourceConfig())) for f in forms)
    assert len(first) == 1988
    for other in others:
        assert_same(first, other)


def test_bag_and_mcap_of_one_drive_agree(shared_data: Path) -> None:
    bag = open_source(shared_data / "robot_bags/dec13_target_before.bag", SourceConfig())
    mcap = open_source(shared_data / "ros2/dec13_target_before_mcap", SourceConfig())
    assert_same(odometry(bag), odometry(mcap))
    for one, other in zip(bag, mcap, strict=True):
        np.testing.assert_array_equal(one.scan.ranges_m, other.scan.ranges_m)


@pytest.mark.parametrize(
    ("name", "scans", "error_m"),
    [("intel", 13631, 7.370), ("fr079", 4934, 6.504), ("mit-csail", 1988, 1.682)],
)
@pytest.mark.parametrize(("ending", "tolerance"), [("clf.gz", 0.01), ("bag", 0.05)])
def test_raw_odometry_has_the_known_error(
    shared_data: Path, name: str, scans: int, error_m: float, ending: str, tolerance: float
) -> None:
    source = open_source(shared_data / "benchmark" / f"{name}.{ending}", SourceConfig())
    statuses = source.scan_statuses()
    assert len(statuses) == scans
    assert not any(status.reason for status in statuses)
    path = odometry(source, at_laser=True)
    assert len(path) > 0.999 * scans
    relations = read_relations(shared_data / "benchmark" / f"{name}.relations")
    first, second = (path.at(relations.stamps_ns[:, k]) for k in (0, 1))
    wrong = between(relations.first_from_second, between(first, second))
    mean_m = float(np.linalg.norm(wrong[:, :2], axis=1).mean())
    assert mean_m == pytest.approx(error_m, rel=tolerance)


def test_the_order_of_topics_in_the_file_does_not_matter(shared_data: Path) -> None:
    usual = open_source(shared_data / "benchmark/fr079.bag", SourceConfig())
    shuffled = open_source(shared_data / "odd_bags/fr079_file_order.bag", SourceConfig())
    assert_same(odometry(usual), odometry(shuffled))


def test_a_bag_that_rosbags_refuses_is_read_whole(shared_data: Path) -> None:
    source = open_source(shared_data / "odd_bags/refused_by_reader.bag", SourceConfig())
    assert len(list(source)) == 360


def test_scans_alone_are_enough(shared_data: Path) -> None:
    source = open_source(shared_data / "ros2/gazebo_scan_only", SourceConfig())
    got = list(source)
    assert len(got) == 922
    assert all(reading.odom_from_robot is None for reading in got)
    assert any("no odometry found" in notice for notice in source.info().notices)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("two_scanners.bag", "choose with --scan /front_scan or --scan /rear_scan"),
        ("tilting_laser.bag", "is tilted 40.0 deg about y; 2D needs < 5 deg"),
        ("rosrecord_v1_2.bag", "has the old format ROSRECORD V1.2"),
    ],
)
def test_odd_bags_are_refused_in_one_line(shared_data: Path, name: str, line: str) -> None:
    with pytest.raises(BadInput) as caught:
        open_source(shared_data / "odd_bags" / name, SourceConfig())
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_of_two_scanners(shared_data: Path) -> None:
    config = SourceConfig(scan_topic="/rear_scan")
    assert len(list(open_source(shared_data / "odd_bags/two_scanners.bag", config))) == 330
