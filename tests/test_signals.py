# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of signal strength from files and topics, and where on the way they were taken."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.signals.rss import beside, open_rss
from slarm_graph.radio.measured.rss_log import RssLog, merged, place
from slarm_graph.trajectory import Trajectory


def test_csv_with_what_was_not_heard(tmp_path):
    path = tmp_path / "wifi.csv"
    path.write_text("stamp, ap, rss_dbm\n12.5,b,-60\n12.123456789,a,-70.5\n13,b,\n")
    log = open_rss(str(path))
    assert log.names == ("a", "b")
    assert log.stamps_ns.tolist() == [12_123_456_789, 12_500_000_000, 13_000_000_000]
    assert log.access_point.tolist() == [0, 1, 1]
    np.testing.assert_array_equal(log.rss_dbm, [-70.5, -60.0, np.nan])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,rssi\n1,2\n", "it needs ap"),
        ("stamp,ap,rss_dbm\n1,a,loud\n", "csv:2: not a reading"),
        ("stamp,ap,rss_dbm\nnan,a,-50\n", "csv:2: not a reading"),
        ("stamp,rss_dbm,ap\n1,-50,a\n2,-51\n", "csv:3: not a reading (fewer values than columns)"),
        ("rss_dbm,ap,stamp\n-50,a\n", "csv:2: not a reading (fewer values than columns)"),
        ("stamp,ap,rss_dbm\n", "no reading"),
        ("", "columns of nothing"),
    ],
)
def test_csv_faults_are_told(tmp_path, text, message):
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=re.escape(message)):
        open_rss(str(path))


@pytest.mark.parametrize(
    ("levels", "told"),
    [
        ((-60.0, -61.0, np.nan), ()),
        ((-150.0, 40.0), ()),
        ((-60.0, -150.1, -70.0), ("1 of 3 readings", "a at -150.1")),
        ((np.inf, 55.0), ("1 of 2 readings", "a at 55", "in dBm?")),
        ((40.1,), ("1 of 1 reading of",)),
        ((-60.0, -60.0, np.nan), ("every reading", "-60 dBm")),
        ((-60.0, np.nan), ()),
        ((np.nan, np.nan), ()),
    ],
)
def test_levels_that_no_radio_can_tell_are_doubted(levels, told):
    log = RssLog.of_rows(np.arange(len(levels)), ["a"] * len(levels), np.array(levels), "")
    doubts = " ".join(log.doubts())
    assert bool(doubts) == bool(told)
    assert all(words in doubts for words in told)


def packet(rssi):
    return f"1\t1\t500\t{rssi}\t100223\t3323\t19\t0"


def test_log_of_anchors(tmp_path):
    head = "1628001616204\t11\t201\t107\t100235"
    silent = "1628001617204\t11\t202\t108\t100235\t0\t0"
    path = tmp_path / "drive_ble.txt"
    path.write_text(f"{head}\t2\t0\t{packet(-60)}\t{packet(-64)}\n{silent}\n")
    log = open_rss(str(path))
    assert log.names == ("100235",)
    np.testing.assert_array_equal(log.rss_dbm, [-62.0, np.nan])
    assert log.stamps_ns[1] - log.stamps_ns[0] == 1_000_000_000
    assert beside(tmp_path / "drive_scan.txt") == str(path)
    assert beside(tmp_path / "other_scan.txt") is None


def test_topic_of_a_bag_by_its_own_definitions(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/PointStamped"
    point, header = store.types[kind], store.types["std_msgs/msg/Header"]
    time, xyz = store.types["builtin_interfaces/msg/Time"], store.types["geometry_msgs/msg/Point"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/wifi", kind, typestore=store)
        for second, name, rss in ((3, "x", -50.0), (4, "y", -61.0)):
            message = point(header(time(second, 7), name), xyz(rss, 0.0, 0.0))
            writer.write(connection, 10**9, store.serialize_cdr(message, kind))
    log = open_rss("/wifi:point.x,header.frame_id", [tmp_path / "bag"])
    assert log.names == ("x", "y")
    assert log.stamps_ns.tolist() == [3_000_000_007, 4_000_000_007]
    np.testing.assert_array_equal(log.rss_dbm, [-50.0, -61.0])
    with pytest.raises(BadInput, match="has /wifi"):
        open_rss("/wlan:rssi", [tmp_path / "bag"])
    for given, message in (
        ("/wifi:rssi", "no field 'rssi' in geometry_msgs/msg/PointStamped; it has header, point$"),
        ("/wifi:point.x.y", "no field 'y' in float; it has no parts"),
        ("/wifi:", "no field '' in geometry_msgs/msg/PointStamped"),
        ("/wifi:point.x,ssid", "no field 'ssid'"),
        ("/wifi:point", r"point is a geometry_msgs/msg/Point, no number.*: point.x, point.y"),
        ("/wifi:header.frame_id", "header.frame_id is a str, no number"),
    ):
        with pytest.raises(BadInput, match=message):
            open_rss(given, [tmp_path / "bag"])


def test_types_of_an_older_release_where_a_bag_has_no_definitions(tmp_path):
    store, kind = get_typestore(Stores.ROS2_FOXY), "visualization_msgs/msg/Marker"
    make = {name.rpartition("/")[2]: made for name, made in store.types.items()}
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/heard", kind, typestore=store)
        header = make["Header"](make["Time"](5, 0), "map")
        none = make["Point"](0.0, 0.0, 0.0), make["Quaternion"](0.0, 0.0, 0.0, 1.0)
        at, color = make["Pose"](*none), make["ColorRGBA"](0.0, 0.0, 0.0, 1.0)
        size, forever = make["Vector3"](-42.0, 0.0, 0.0), make["Duration"](0, 0)
        message = make["Marker"](
            header, "ap", 1, 0, 0, at, size, color, forever, False, [], [], "ap one", "", False
        )
        writer.write(connection, 10**9, store.serialize_cdr(message, kind))
    with closing(sqlite3.connect(next((tmp_path / "bag").glob("*.db3")))) as file:
        # As recorders before iron leave it.
        file.execute("DELETE FROM message_definitions")
        file.commit()
    log = open_rss("/heard:scale.x,text", [tmp_path / "bag"], "foxy")
    assert log.names == ("ap one",) and log.rss_dbm.tolist() == [-42.0]
    with pytest.raises(BadInput, match="--ros-distro"):
        open_rss("/heard:scale.x,text", [tmp_path / "bag"])


def test_neither_file_nor_topic():
    with pytest.raises(BadInput, match="/TOPIC:FIELD"):
        open_rss("nowhere.csv")


def test_readings_get_the_pose_at_their_own_stamp():
    way = Trajectory(np.array([0, 10]) * 10**9, np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 1.0]]))
    stamps = np.array([-1, 2, 5, 11]) * 10**9
    log = RssLog.of_rows(stamps, ["a", "a", "b", "b"], np.array([-1.0, -50.5, -60.0, -70.0]), "x")
    placed = place(log, way, 0.02)
    assert placed.outside == 2
    np.testing.assert_allclose(placed.readings["a"].points_m, [[2.0, 0.0]])
    np.testing.assert_allclose(placed.readings["b"].headings_rad, [0.5])
    # A whole decibel among means of several is a packet of its own, with a noise of its own.
    assert placed.readings["a"].noise_class.tolist() == [0]
    assert placed.readings["b"].noise_class.tolist() == [1]
    both = merged([log, log])
    assert len(both) == 8
    assert both.names == ("a", "b")


def test_text_log_of_a_lidar_with_its_motion(tmp_path):
    """A robot that turns left sees what stands still move right."""
    scans, motion = tmp_path / "drive_scan.txt", tmp_path / "drive_motion.txt"
    angles = np.arange(500, 360_000, 850)
    lines = []
    for k in range(8):
        turned = 0.96 * 0.5 * k
        bearing = np.radians(angles / 1000) + turned
        ranges = 200 + 100 * np.cos(bearing) ** 2 + 50 * np.cos(bearing)
        lines += [f"{100 + 0.5 * k:.3f}", str(angles.tolist()), str(ranges.astype(int).tolist())]
    scans.write_text("\n".join(lines).replace(",", "") + "\n")
    motion.write_text("99.0,stop,0.15\n99.57,left,0.15\n")
    source = open_source(scans, SourceConfig())
    readings = list(source)
    assert len(readings) == 8
    first, last = readings[0], readings[-1]
    assert first.stamp_ns == 99_790_000_000
    turned = last.odom_from_robot.theta - first.odom_from_robot.theta
    assert turned % (2 * np.pi) == pytest.approx(0.96 * 3.5)
    returns = first.scan.is_return()
    assert returns.sum() == len(angles)
    assert first.scan.angles_rad()[0] == pytest.approx(0.0)
    at = np.flatnonzero(returns)[100]
    angle = np.degrees(first.scan.angles_rad()[at])
    assert np.abs(angles / 1000 - angle).min() <= 0.25
    without = list(open_source(scans, SourceConfig(odom="none")))
    assert without[0].odom_from_robot is None
    motion.write_text("99.0,jump,1\n")
    with pytest.raises(BadInput, match=r"motion.txt:1"):
        open_source(scans, SourceConfig())
