# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The column decoders against rosbags' own deserializer, on random messages of every encoding."""

from __future__ import annotations

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from slarm_graph.frontends.messages import (
    MULTI_ECHO,
    TF_TYPES,
    decode,
    read_multi_echo,
    read_odometry,
    read_scans,
    read_transforms,
)
from slarm_graph.frontends.packed import Malformed, pack

ENCODINGS = ["ros1", "cdr little", "cdr big"]
STORES = {
    "ros1": Stores.ROS1_NOETIC,
    "cdr little": Stores.ROS2_HUMBLE,
    "cdr big": Stores.ROS2_HUMBLE,
}
LIMITS = (
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
)
FRAMES = ["laser", "/laser", "a_rather_long_frame_name", "", "é"]


class Writer:
    """Makes and serializes messages of one encoding."""

    def __init__(self, encoding: str) -> None:
        self.encoding = encoding
        self.store = get_typestore(STORES[encoding])
        if encoding == "ros1":
            tf = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(tf, TF_TYPES[0]))
        self.t = self.store.types
        self.cdr = encoding != "ros1"

    def header(self, stamp_ns: int, frame: str) -> object:
        time = self.t["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        seq = {} if self.cdr else {"seq": 7}
        return self.t["std_msgs/msg/Header"](stamp=time, frame_id=frame, **seq)

    def raw(self, message: object) -> bytes:
        kind = message.__msgtype__  # type: ignore[attr-defined]
        if not self.cdr:
            return bytes(self.store.serialize_ros1(message, kind))
        return bytes(
            self.store.serialize_cdr(message, kind, little_endian=self.encoding == "cdr little")
        )

    def scan(self, rng: np.random.Generator, beams: int) -> object:
        floats = dict(
            zip(
                [
                    "angle_min",
                    "angle_max",
                    "angle_increment",
                    "time_increment",
                    "scan_time",
                    "range_min",
                    "range_max",
                ],
                rng.normal(size=7).astype(np.float32).tolist(),
                strict=True,
            )
        )
        ranges = rng.normal(size=beams).astype(np.float32)
        ranges[rng.random(beams) < 0.2] = np.inf
        return self.t["sensor_msgs/msg/LaserScan"](
            header=self.header(int(rng.integers(2**60)), str(rng.choice(FRAMES))),
            ranges=ranges,
            intensities=rng.normal(size=int(rng.integers(0, 3))).astype(np.float32),
            **floats,
        )

    def multi_echo(self, rng: np.random.Generator, beams: int, *, lit: bool) -> object:
        echo = self.t["sensor_msgs/msg/LaserEcho"]
        counts = rng.integers(0, 4, size=beams)
        lists = [
            [echo(echoes=rng.normal(size=n).astype(np.float32)) for n in counts] for _ in range(2)
        ]
        return self.t[MULTI_ECHO](
            header=self.header(int(rng.integers(2**60)), str(rng.choice(FRAMES))),
            angle_min=-1.0,
            angle_max=1.0,
            angle_increment=0.1,
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=30.0,
            ranges=lists[0],
            intensities=lists[1] if lit else [],
        )

    def pose(self, rng: np.random.Generator) -> tuple[object, object]:
        point, turn = rng.normal(size=3), rng.normal(size=4)
        return (
            self.t["geometry_msgs/msg/Point"](*point.tolist()),
            self.t["geometry_msgs/msg/Quaternion"](*turn.tolist()),
        )

    def odometry(self, rng: np.random.Generator) -> object:
        g = "geometry_msgs/msg/"
        zero = self.t[g + "Vector3"](0.0, 0.0, 0.0)
        pose = self.t[g + "Pose"](*self.pose(rng))
        return self.t["nav_msgs/msg/Odometry"](
            header=self.header(int(rng.integers(2**60)), str(rng.choice(["odom", "/odom"]))),
            child_frame_id=str(rng.choice(["base_link", "base", ""])),
            pose=self.t[g + "PoseWithCovariance"](pose, rng.normal(size=36)),
            twist=self.t[g + "TwistWithCovariance"](self.t[g + "Twist"](zero, zero), np.zeros(36)),
        )

    def tf(self, rng: np.random.Generator, count: int) -> object:
        g = "geometry_msgs/msg/"
        parts = []
        for _ in range(count):
            point, turn = self.pose(rng)
            move = self.t[g + "Transform"](self.t[g + "Vector3"](point.x, point.y, point.z), turn)
            header = self.header(int(rng.integers(2**60)), str(rng.choice(FRAMES)))
            parts.append(self.t[g + "TransformStamped"](header, str(rng.choice(FRAMES)), move))
        return self.t[TF_TYPES[0]](transforms=parts)


def packed(writer: Writer, messages: list[object]):
    return pack((number, writer.raw(message)) for number, message in enumerate(messages))


def stamp_ns(header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


LIMITS = [
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_scans_of_any_frame_and_beam_count_are_read_as_rosbags_reads_them(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(1)
    messages = [writer.scan(rng, int(rng.choice([0, 1, 5, 360]))) for _ in range(60)]
    (blocks,) = decode([packed(writer, messages)], read_scans, cdr=writer.cdr)
    assert sorted(np.concatenate([b.index for b in blocks]).tolist()) == list(range(60))
    for block in blocks:
        for line, number in enumerate(block.index.tolist()):
            message = messages[number]
            assert block.stamp_ns[line] == stamp_ns(message.header)
            assert block.record_ns[line] == number
            assert block.frame == message.header.frame_id.lstrip("/")
            np.testing.assert_array_equal(block.ranges_m[line], message.ranges)
            want = [np.float32(getattr(message, name)) for name in LIMITS]
            np.testing.assert_array_equal(block.limits[line], want)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("echo", ["first", "last", "strongest"])
@pytest.mark.parametrize("lit", [True, False])
def test_one_echo_per_beam(encoding: str, echo: str, lit: bool) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(2)
    messages = [writer.multi_echo(rng, int(rng.choice([0, 4, 30])), lit=lit) for _ in range(20)]

    def one(cursor):
        return read_multi_echo(cursor, echo)

    (blocks,) = decode([packed(writer, messages)], one, cdr=writer.cdr)
    for block in blocks:
        for line, number in enumerate(block.index.tolist()):
            message = messages[number]
            want = []
            for beam, wrapped in enumerate(message.ranges):
                echoes = wrapped.echoes
                if len(echoes) == 0:
                    want.append(np.nan)
                elif echo == "strongest" and lit:
                    want.append(echoes[np.argmax(message.intensities[beam].echoes)])
                else:
                    want.append(echoes[-1 if echo == "last" else 0])
            np.testing.assert_array_equal(block.ranges_m[line], np.array(want, np.float32))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_odometry_is_read_as_rosbags_reads_it(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(3)
    messages = [writer.odometry(rng) for _ in range(40)]
    (out,) = decode([packed(writer, messages)], read_odometry, cdr=writer.cdr)
    for row, message in enumerate(messages):
        pose = message.pose.pose
        assert out.stamp_ns[row] == stamp_ns(message.header)
        want = (message.header.frame_id.lstrip("/"), message.child_frame_id)
        assert out.edges[out.edge[row]] == want
        p, q = pose.position, pose.orientation
        assert out.translations_m[row].tolist() == [p.x, p.y, p.z]
        assert out.quaternions[row].tolist() == [q.x, q.y, q.z, q.w]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_transforms_of_one_message_stay_in_order(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(4)
    messages = [writer.tf(rng, int(rng.integers(0, 4))) for _ in range(40)]
    (out,) = decode([packed(writer, messages)], read_transforms, cdr=writer.cdr)
    want = [(number, t) for number, m in enumerate(messages) for t in m.transforms]
    assert len(out) == len(want)
    for row, (number, t) in enumerate(want):
        assert out.stamp_ns[row] == stamp_ns(t.header)
        assert out.record_ns[row] == number
        names = (t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/"))
        assert out.edges[out.edge[row]] == names
        v, q = t.transform.translation, t.transform.rotation
        assert out.translations_m[row].tolist() == [v.x, v.y, v.z]
        assert out.quaternions[row].tolist() == [q.x, q.y, q.z, q.w]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_message_cut_short_is_told_and_nothing_outside_it_is_read(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(5)
    raw = writer.raw(writer.scan(rng, 30))
    echoes = writer.raw(writer.multi_echo(rng, 10, lit=False))
    for cut in (1, 5, 40, len(raw) // 2):
        with pytest.raises(Malformed):
            decode([pack([(0, raw[: -cut - 24]), (1, raw)])], read_scans, cdr=writer.cdr)
    with pytest.raises(Malformed):
        decode([pack([(0, echoes[:-12]), (1, raw)])], read_multi_echo, cdr=writer.cdr)


def test_nothing_recorded_is_nothing_read() -> None:
    assert decode([pack([])], read_scans, cdr=False) == [[]]
    assert decode([pack([])], read_scans, cdr=True) == []
    assert len(decode([pack([])], read_transforms, cdr=False)[0]) == 0
