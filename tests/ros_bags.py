# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Make ROS messages and recordings of every kind, for the tests of what reads them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from slarm_graph.frontends.recordings.messages import MULTI_ECHO, TF_TYPES

KINDS = ["bag", "db3", "mcap"]
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
        floats = dict(zip(LIMITS, rng.normal(size=7).astype(np.float32).tolist(), strict=True))
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

    def laser_scan(
        self,
        stamp_s: float,
        ranges: Iterable[float],
        *,
        frame: str = "laser",
        angles: tuple[float, float] = (-1.5, 0.05),
        limits: tuple[float, float] = (0.1, 10.0),
        times: tuple[float, float] = (0.0, 0.0),
    ) -> object:
        """Make a scan from what matters."""
        values = np.array(list(ranges), np.float32)
        return self.t["sensor_msgs/msg/LaserScan"](
            header=self.header(round(stamp_s * 1e9), frame),
            angle_min=angles[0],
            angle_max=angles[0] + angles[1] * max(len(values) - 1, 0),
            angle_increment=angles[1],
            time_increment=times[0],
            scan_time=times[1],
            range_min=limits[0],
            range_max=limits[1],
            ranges=values,
            intensities=np.zeros(0, np.float32),
        )

    def odom(
        self,
        stamp_s: float,
        x: float = 0.0,
        y: float = 0.0,
        yaw: float = 0.0,
        *,
        child: str = "base_link",
        quaternion: tuple[float, float, float, float] | None = None,
    ) -> object:
        """Make an odometry message from a planar pose."""
        g = "geometry_msgs/msg/"
        turn = quaternion or (0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
        pose = self.t[g + "Pose"](self.t[g + "Point"](x, y, 0.0), self.t[g + "Quaternion"](*turn))
        zero = self.t[g + "Vector3"](0.0, 0.0, 0.0)
        return self.t["nav_msgs/msg/Odometry"](
            header=self.header(round(stamp_s * 1e9), "odom"),
            child_frame_id=child,
            pose=self.t[g + "PoseWithCovariance"](pose, np.zeros(36)),
            twist=self.t[g + "TwistWithCovariance"](self.t[g + "Twist"](zero, zero), np.zeros(36)),
        )

    def transforms(
        self,
        stamp_s: float,
        *edges: tuple[str, str, tuple[float, float, float], tuple[float, float, float, float]],
    ) -> object:
        """Make a tf message from (parent, child, translation, quaternion x y z w)."""
        g = "geometry_msgs/msg/"
        return self.t[TF_TYPES[0]](
            transforms=[
                self.t[g + "TransformStamped"](
                    self.header(round(stamp_s * 1e9), parent),
                    child,
                    self.t[g + "Transform"](
                        self.t[g + "Vector3"](*place), self.t[g + "Quaternion"](*turn)
                    ),
                )
                for parent, child, place, turn in edges
            ]
        )


Recorded = tuple[str, float, object]
"""Topic, record time [s], message."""


def write_recording(
    path: Path, messages: Iterable[Recorded], kind: str = "bag", *, compression: str = ""
) -> Path:
    """Write a ROS 1 bag, or a ROS 2 folder with sqlite3 or mcap storage."""
    maker = maker_of(kind)
    with _writer(path, kind, compression) as writer:
        known: dict[tuple[str, str], Connection] = {}
        for topic, record_s, message in messages:
            msgtype = message.__msgtype__  # type: ignore[attr-defined]
            if (topic, msgtype) not in known:
                known[topic, msgtype] = writer.add_connection(topic, msgtype, typestore=maker.store)
            writer.write(known[topic, msgtype], round(record_s * 1e9), maker.raw(message))
    return path


def _writer(path: Path, kind: str, compression: str) -> Writer1 | Writer2:
    if kind == "bag":
        writer = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression])
        return writer
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    folder = Writer2(path, version=9, storage_plugin=plugin)
    if compression:
        folder.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    return folder


def maker_of(kind: str) -> Writer:
    """Return the maker of messages for a kind of recording."""
    return Writer("ros1" if kind == "bag" else "cdr little")


IDENTITY = (0.0, 0.0, 0.0, 1.0)
"""Quaternion x y z w."""
