# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Signal strength in a bag: used where it is unmistakable, told of where it may be."""

from __future__ import annotations

import numpy as np
import pytest
from ros_bags import Writer as Messages
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg

from slarm_graph.app.cli import main
from slarm_graph.config import SignalConfig, SimulationConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.convert import convert
from slarm_graph.frontends.signals.rss import open_rss
from slarm_graph.frontends.signals.rss_found import found_rss
from slarm_graph.radio.measured.files import read_measured_npz

KIND = "radio_msgs/msg/Heard"
ROOM = (
    "name: room\nceiling_m: 3.0\nboundary_m: [[0, 0], [5, 0], [5, 4], [0, 4]]\n"
    "start: {x_m: 1.0, y_m: 1.0, heading_deg: 0.0}\n"
    "access_points: [{name: ap, x_m: 0.5, y_m: 0.5, z_m: 2.5}]\n"
)


def bag(path, rows, definition=None, *, topic="/wifi", kind=KIND, parts=()):
    """Write rows of one topic; `parts` are (type, definition) of messages inside it."""
    messages = Messages("ros1" if path.suffix == ".bag" else "cdr little")
    for name, text in (*parts, *([(kind, definition)] if definition else [])):
        messages.store.register(get_types_from_msg(text, name))
    writer = Writer1(path) if path.suffix == ".bag" else Writer2(
        path, version=9, storage_plugin=StoragePlugin.MCAP
    )  # fmt: skip
    with writer:
        connection = writer.add_connection(topic, kind, typestore=messages.store)
        for k, row in enumerate(rows):
            values = row(messages.store.types) if callable(row) else row
            writer.write(connection, (k + 1) * 10**9, messages.raw(messages.t[kind](*values)))
    return path


def levels(low=-70.0, count=12):
    return [low + k for k in range(count)]


@pytest.mark.parametrize("name", ["a.bag", "folder"])
@pytest.mark.parametrize(
    ("field", "beside", "option", "names"),
    [
        ("float32 rssi", "string bssid\nstring ssid", "rssi,bssid", ("x", "y")),
        ("int16 rss_dbm", "string access_point\nint32 n", "rss_dbm,access_point", ("x", "y")),
        ("int8 signalLevelDbm", "string note\nint32 n", "signalLevelDbm", ("wifi",)),
    ],
)
def test_what_is_unmistakable_is_read(tmp_path, name, field, beside, option, names):
    whose = ["x", "y"] * 6
    number = field.startswith("float") is False
    rows = [
        (int(v) if number else v, w, k if "int32" in beside else "net")
        for k, (v, w) in enumerate(zip(levels(), whose, strict=True))
    ]
    (found,) = found_rss([bag(tmp_path / name, rows, f"{field}\n{beside}")])
    assert found.option == f"/wifi:{option}"
    assert found.log is not None and found.log.names == names
    np.testing.assert_array_equal(np.sort(found.log.rss_dbm), levels())
    assert f"used as --rss /wifi:{option}; --rss none" in found.notice()


@pytest.mark.parametrize(
    ("definition", "rows", "told"),
    [
        ("float32 rssi", [(v,) for v in levels(-5.0)], "values from -5 to 6 are no dBm"),
        ("float32 rssi", [(v,) for v in levels(-11.0)], "values from -11 to 0 are no dBm"),
        ("float32 rssi", [(v,) for v in levels(-150.0)], "values from -150 to -139 are no dBm"),
        ("float32 rssi", [(float("nan"),)] * 9, "no reading has a value"),
        ("float32 rssi\nstring uuid", [(v, f"{v}") for v in levels()], "12 readings have 12 names"),
        ("int8 rssi_a_dbm\nint8 rssi", [(-50, -51)] * 9, ""),
        ("int8 rssi_ant\nint8 rssi", [(-50, -51)] * 9, "one of rssi_ant, rssi"),
    ],
)
def test_what_may_be_is_told_with_what_uses_it(tmp_path, definition, rows, told):
    found = found_rss([bag(tmp_path / "a.bag", rows, definition)])
    if not told:
        assert [one.log is not None for one in found] == [True]
        return
    for one in found:
        assert one.log is None
        assert told in one.notice() and f"--rss {one.option} uses it" in one.notice()
        assert len(open_rss(one.option, [tmp_path / "a.bag"])) == len(rows)


def test_names_of_the_edge(tmp_path):
    """At -140 dBm and with three readings a name it still is one; at 0 dBm no more."""
    rows = [(v, w) for w in "ab" for v in (-140.0, -90.0, -0.5)]
    (found,) = found_rss([bag(tmp_path / "a.bag", rows, "float32 rssi\nstring mac")])
    assert found.log is not None and found.log.names == ("a", "b")


@pytest.mark.parametrize(
    "definition", ["float32 rssi_threshold", "float32 rssi_sd", "string rssi", "float32 boss"]
)
def test_what_only_sounds_alike_is_not_told(tmp_path, definition):
    rows = [("-50",) if "string" in definition else (-50.0,)] * 9
    assert found_rss([bag(tmp_path / "a.bag", rows, definition)]) == ()


def test_counters_are_no_names(tmp_path):
    rows = [(-50.0, k, "a") for k in range(12)]
    definition = "float32 rssi\nint32 packet_id\nstring device_name"
    (found,) = found_rss([bag(tmp_path / "a.bag", rows, definition)])
    assert found.option == "/wifi:rssi,device_name"


def test_a_number_on_a_topic_of_that_name(tmp_path):
    rows = [(v,) for v in levels()]
    where = {"topic": "/robot/wifi_rssi", "kind": "std_msgs/msg/Float32"}
    (found,) = found_rss([bag(tmp_path / "a.bag", rows, **where)])
    assert found.option == "/robot/wifi_rssi:data"
    assert found.log is not None and found.log.names == ("robot/wifi_rssi",)
    where["topic"] = "/battery"
    assert found_rss([bag(tmp_path / "b.bag", rows, **where)]) == ()


def test_lists_of_what_was_heard_at_once(tmp_path):
    part = "radio_msgs/msg/Network", "string bssid\nint8 rssi\n"

    def row(k):
        return lambda types: ([types[part[0]](n, -60 - k) for n in "abc"[: k % 4]],)

    path = bag(tmp_path / "a", [row(k) for k in range(12)], "Network[] networks", parts=[part])
    (found,) = found_rss([path])
    assert found.option == "/wifi:networks.rssi,networks.bssid"
    assert found.log is not None
    assert found.log.names == ("a", "b", "c")
    counts = np.bincount(found.log.access_point).tolist()
    assert counts == [9, 6, 3]
    first_c = found.log.rss_dbm[found.log.access_point == 2][0]
    assert first_c == -63.0
    np.testing.assert_array_equal(np.unique(found.log.stamps_ns) // 10**9 % 4, [2, 3, 0] * 3)


def test_a_list_of_names_has_to_fit(tmp_path):
    path = bag(
        tmp_path / "a", [(np.array([-50, -60], np.int8), ["a"] * 3)], "int8[] rssi\nstring[] mac"
    )
    with pytest.raises(BadInput, match="3 of mac for 2 levels"):
        open_rss("/wifi:rssi,mac", [path])
    (found,) = found_rss([path])
    assert "may hold signal strength" in found.notice() and "3 of mac" in found.notice()


def test_what_rosbags_cannot_read_is_told_by_the_topics_name(tmp_path):
    rows = [(v,) for v in levels()]
    for topic, told in (("/rssi", ["/rssi"]), ("/wifi", [])):
        path = bag(tmp_path / f"{len(told)}.bag", rows, "float32 rssi", topic=topic)
        text = path.read_bytes()
        path.write_bytes(text.replace(b"float32 rssi", b"fl()t32 rssi"))
        found = found_rss([path])
        assert [one.topic for one in found] == told
        assert all(one.log is None and "cannot be read" in one.notice() for one in found)


def test_no_bag_and_no_such_topic_find_nothing(tmp_path):
    (tmp_path / "a.txt").write_text("PARAM x\n")
    assert found_rss([tmp_path / "a.txt"]) == ()
    rows = [(v,) for v in levels()]
    made = bag(tmp_path / "a.bag", rows, topic="/temperature", kind="std_msgs/msg/Float32")
    assert found_rss([made]) == ()


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    (folder / "room.yaml").write_text(ROOM)
    config = SimulationConfig(signals=SignalConfig(rate_hz=10.0))
    convert(folder / "room.yaml", folder / "room.bag", simulation=config)
    return folder / "room.bag"


def run(room, folder, capsys, *words):
    """Run by odometry alone; returns the folder and what was told."""
    how = ["--backend", "odometry", "--out", str(folder), "--name", "r", *words]
    assert main(["run", str(room), *how]) == 0
    return folder / "r", capsys.readouterr().err


def test_a_run_uses_it_unless_told_not_to(room, tmp_path, capsys):
    (note,) = [f for f in check(room).findings if f.where == "/rss"]
    assert note.severity == "note" and "--rss none leaves it out" in note.advice
    made, told = run(room, tmp_path / "a", capsys)
    assert "used as --rss /rss:rss_dbm,access_point" in told
    asked, told = run(room, tmp_path / "b", capsys, "--rss", "/rss:rss_dbm,access_point")
    assert "signal strength" not in told
    one, other = (read_measured_npz(folder / "measured_radio_map.npz") for folder in (made, asked))
    np.testing.assert_array_equal(one.mean_dbm, other.mean_dbm)
    left, told = run(room, tmp_path / "c", capsys, "--rss", "none")
    assert not (left / "measured_radio_map.npz").exists()
    assert "signal strength" not in told


def test_what_was_found_and_makes_no_map_ends_no_run(room, tmp_path, capsys):
    least = ["--set", "measured.least_readings=100000"]
    made, told = run(room, tmp_path, capsys, *least)
    assert not (made / "measured_radio_map.npz").exists()
    assert "no measured radio map of /rss" in told
    asked = ["--rss", "/rss:rss_dbm,access_point", *least]
    assert main(["run", str(room), "--backend", "odometry", "--out", str(tmp_path / "z"), *asked])
