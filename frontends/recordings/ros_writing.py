# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Write readings as a ROS recording that RViz, nav2 and every SLAM package can play."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.rotations import quaternion_of
from slarm_graph.geometry import Pose2
from slarm_graph.readings import LaserScan, Reading, Signal

_TF = "tf2_msgs/msg/TFMessage"
_ODOMETRY = "nav_msgs/msg/Odometry"
_POSE = "geometry_msgs/msg/PoseStamped"
_SCAN = "sensor_msgs/msg/LaserScan"
_SIGNAL = "slarm_msgs/msg/SignalStrength"
_SIGNAL_FIELDS = "std_msgs/Header header\nstring access_point\nfloat32 rss_dbm\n"
"""ROS has no message for signal strength. nan: listened for and not heard."""

GROUND_TRUTH_TOPIC = "/ground_truth"
SIGNAL_TOPIC = "/rss"
SIGNAL_OPTION = f"{SIGNAL_TOPIC}:rss_dbm,access_point"
"""The value of `--rss` that reads it."""


def write_readings(
    destination: Path,
    readings: Iterable[Reading],
    *,
    truth: Iterable[tuple[int, Pose2]] = (),
    upside_down: bool = False,
    overwrite: bool = False,
) -> int:
    """Record readings: /scan, /odom, /tf (odom -> base_link) and /tf_static (base_link -> laser).

    Signal strengths that come with readings go to /rss.

    Parameters
    ----------
    destination : Path
        `.bag` is ROS 1; `.mcap` and `.db3` are single ROS 2 files; any other name is a ROS 2
        folder (mcap).
    readings : iterable of Reading
    truth : iterable of (stamp [ns], map_from_robot)
        Written to /ground_truth as geometry_msgs/PoseStamped.
    upside_down : bool
        Record a laser that hangs upside down: its z axis points down in tf and its angles count
        the other way round. What is read back is the same.
    overwrite : bool

    Returns
    -------
    int
        Number of scans written.

    Raises
    ------
    BadInput
        When the destination exists or cannot be written, or the laser moves on the robot.
    """
    with open_new_bag(destination, overwrite=overwrite) as bag:
        count, mounting = 0, None
        for reading in readings:
            if mounting is None:
                mounting = reading.scan.robot_from_laser
                roll = math.pi if upside_down else 0.0
                bag.transform(
                    "/tf_static", reading.stamp_ns, "base_link", "laser", mounting, roll_rad=roll
                )
            if reading.scan.robot_from_laser != mounting:
                raise BadInput("the laser moves on the robot: cannot be written with a static tf")
            bag.scan(reading.stamp_ns, reading.scan, angle_sign=-1.0 if upside_down else 1.0)
            if reading.odom_from_robot is not None:
                bag.odometry(reading.stamp_ns, reading.odom_from_robot)
            for signal in reading.signals:
                bag.signal(reading.stamp_ns, signal)
            count += 1
        for stamp_ns, pose in truth:
            bag.pose(GROUND_TRUTH_TOPIC, stamp_ns, pose)
    return count


@contextmanager
def open_new_bag(destination: Path, *, overwrite: bool = False) -> Iterator[BagWriter]:
    """Open a new recording for writing; it is renamed to its path when complete."""
    prepare_destination(destination, overwrite=overwrite)
    with tempfile.TemporaryDirectory(dir=destination.parent, prefix=".writing-") as folder:
        made = Path(folder) / destination.name
        single = destination.suffix in (".mcap", ".db3")
        place = Path(folder) / destination.stem if single else made
        with BagWriter(place, destination.suffix) as bag:
            yield bag
        written = place / f"{place.name}{destination.suffix}" if single else place
        remove(destination)
        shutil.move(written, destination)


def prepare_destination(destination: Path, *, overwrite: bool) -> None:
    """Check that something can be written.

    Raises
    ------
    BadInput
        When the destination exists, or its folder does not or is read-only.
    """
    if destination.exists() and not overwrite:
        raise BadInput(f"{destination} exists already; remove it or use --overwrite")
    if not destination.parent.is_dir():
        raise BadInput(f"no such folder: {destination.parent}")
    try:
        with tempfile.TemporaryFile(dir=destination.parent):
            pass
    except OSError as error:
        raise BadInput(f"cannot write to {destination.parent}: {error.strerror}") from None


def typestore_of(distro: str | None) -> Typestore:
    """Return the standard message types of a ROS 2 release, or of the latest."""
    return get_typestore(Stores.LATEST if distro is None else Stores(f"ros2_{distro}"))


def remove(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


class BagWriter:
    """Writes typed messages into a ROS 1 or ROS 2 recording."""

    def __init__(self, path: Path, suffix: str) -> None:
        self._ros1 = suffix == ".bag"
        self._store = get_typestore(Stores.ROS1_NOETIC if self._ros1 else Stores.ROS2_JAZZY)
        if self._ros1:
            transforms = "geometry_msgs/TransformStamped[] transforms"
            self._store.register(get_types_from_msg(transforms, _TF))
        self._store.register(get_types_from_msg(_SIGNAL_FIELDS, _SIGNAL))
        plugin = StoragePlugin.SQLITE3 if suffix == ".db3" else StoragePlugin.MCAP
        self._writer: Writer1 | Writer2 = (
            Writer1(path) if self._ros1 else Writer2(path, version=9, storage_plugin=plugin)
        )
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> BagWriter:
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def scan(
        self, stamp_ns: int, scan: LaserScan, frame: str = "laser", *, angle_sign: float = 1.0
    ) -> None:
        """Write a scan to /scan."""
        count, step = len(scan.ranges_m), angle_sign * scan.angle_increment_rad
        start = angle_sign * scan.angle_min_rad
        message = self.make(
            _SCAN,
            self.header(stamp_ns, frame),
            start,
            start + step * max(count - 1, 0),
            step,
            scan.time_increment_s,
            scan.time_increment_s * count,
            scan.range_min_m,
            scan.range_max_m,
            np.asarray(scan.ranges_m, np.float32),
            np.zeros(0, np.float32),
        )
        self.send("/scan", stamp_ns, message, _SCAN)

    def odometry(self, stamp_ns: int, odom_from_robot: Pose2) -> None:
        """Write a pose to /odom and /tf."""
        g = "geometry_msgs/msg/"
        zero = self.make(g + "Vector3", 0.0, 0.0, 0.0)
        none = np.zeros(36)
        message = self.make(
            _ODOMETRY,
            self.header(stamp_ns, "odom"),
            "base_link",
            self.make(g + "PoseWithCovariance", self.pose_message(odom_from_robot), none),
            self.make(g + "TwistWithCovariance", self.make(g + "Twist", zero, zero), none),
        )
        self.send("/odom", stamp_ns, message, _ODOMETRY)
        self.transform("/tf", stamp_ns, "odom", "base_link", odom_from_robot)

    def pose(self, topic: str, stamp_ns: int, map_from_robot: Pose2) -> None:
        """Write a pose in the map as geometry_msgs/PoseStamped."""
        message = self.make(_POSE, self.header(stamp_ns, "map"), self.pose_message(map_from_robot))
        self.send(topic, stamp_ns, message, _POSE)

    def signal(self, stamp_ns: int, signal: Signal) -> None:
        """Write a signal strength to /rss."""
        header = self.header(stamp_ns, "base_link")
        message = self.make(_SIGNAL, header, signal.access_point, signal.rss_dbm)
        self.send(SIGNAL_TOPIC, stamp_ns, message, _SIGNAL)

    def transform(
        self,
        topic: str,
        stamp_ns: int,
        parent: str,
        child: str,
        pose: Pose2,
        *,
        roll_rad: float = 0.0,
    ) -> None:
        """Write `parent_from_child`."""
        g = "geometry_msgs/msg/"
        place = self.make(g + "Vector3", pose.x, pose.y, 0.0)
        moved = self.make(g + "Transform", place, self.quaternion_message(pose.theta, roll_rad))
        stamped = self.make(g + "TransformStamped", self.header(stamp_ns, parent), child, moved)
        self.send(topic, stamp_ns, self.make(_TF, [stamped]), _TF)

    def send(self, topic: str, stamp_ns: int, message: object, msgtype: str) -> None:
        """Write a message."""
        if topic not in self._connections:
            self._connections[topic] = self._connect(topic, msgtype)
        store = self._store
        raw = (store.serialize_ros1 if self._ros1 else store.serialize_cdr)(message, msgtype)
        self._writer.write(self._connections[topic], int(stamp_ns), raw)

    def _connect(self, topic: str, msgtype: str) -> Connection:
        from rosbags.convert.converter import LATCH

        latched = topic == "/tf_static"
        if isinstance(self._writer, Writer1):
            return self._writer.add_connection(
                topic, msgtype, typestore=self._store, latching=int(latched)
            )
        return self._writer.add_connection(
            topic,
            msgtype,
            typestore=self._store,
            offered_qos_profiles=LATCH if latched else [],
        )

    def make(self, msgtype: str, *fields: object, **named: object) -> Any:
        """Build a message from its fields."""
        return self._store.types[msgtype](*fields, **named)  # type: ignore[arg-type]

    def header(self, stamp_ns: int, frame: str) -> Any:
        """Build the header of a message."""
        time = self.make("builtin_interfaces/msg/Time", *divmod(int(stamp_ns), 1_000_000_000))
        sequence = (0,) if self._ros1 else ()
        return self.make("std_msgs/msg/Header", *sequence, time, frame)

    def pose_message(self, pose: Pose2) -> object:
        """Build a geometry_msgs/Pose on the floor."""
        g = "geometry_msgs/msg/"
        point = self.make(g + "Point", pose.x, pose.y, 0.0)
        return self.make(g + "Pose", point, self.quaternion_message(pose.theta))

    def quaternion_message(self, heading_rad: float, roll_rad: float = 0.0) -> object:
        """Build a geometry_msgs/Quaternion of heading and roll."""
        quaternion = quaternion_of(heading_rad, 0.0, roll_rad)
        return self.make("geometry_msgs/msg/Quaternion", *quaternion.tolist())
