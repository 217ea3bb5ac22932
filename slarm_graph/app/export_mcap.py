# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A run's results as a ROS 2 recording, for Foxglove and RViz: path, maps, tf, radio map."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from slarm_graph.access_points import RadioMap
from slarm_graph.files.maps import read_map
from slarm_graph.files.trajectories import read_trajectory, trajectory_file
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.files import read_radio_npz
from slarm_graph.trajectory import Trajectory

_MAP, _ROBOT = "map", "base_link"
_UNKNOWN = -1
"""Of nav_msgs/OccupancyGrid, where nothing is known."""


def write_results_mcap(run: Path, target: Path) -> None:
    """Write /path, /ground_truth, /tf, /map, /geographic_map and, per access point, /radio/NAME.

    A radio map is an OccupancyGrid (0 weakest, 100 strongest gain) and a PointCloud2 with the gain
    [dB], the path loss [dB] and line of sight of every cell.
    """
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".writing-") as folder:
        place = Path(folder) / "results"
        with Writer(place, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            _Recorder(writer).write(run)
        shutil.move(place / "results.mcap", target)


class _Recorder:
    """Messages of a run into an open recording."""

    def __init__(self, writer: Writer) -> None:
        self._writer, self._store = writer, get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Any] = {}
        self._types: Any = self._store.types

    def write(self, run: Path) -> None:
        """Write all that the run's folder has."""
        path = read_trajectory(trajectory_file(run))
        start_ns, end_ns = int(path.stamps_ns[0]), int(path.stamps_ns[-1])
        self._path("/path", path, end_ns)
        if (run / "ground_truth.tum").is_file():
            self._path("/ground_truth", read_trajectory(run / "ground_truth.tum"), end_ns)
        self._transforms(path)
        for name in ("map", "geographic_map"):
            if (run / f"{name}.yaml").is_file():
                grid = read_map(run / f"{name}.yaml")
                self._grid(f"/{name}", grid.geometry, _values_of(grid), start_ns)
        if (run / "radio_map.npz").is_file():
            self._radio(read_radio_npz(run / "radio_map.npz"), start_ns)

    def _send(self, topic: str, kind: str, message: Any, stamp_ns: int) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._store
            )
        data = self._store.serialize_cdr(message, kind)
        self._writer.write(self._connections[topic], stamp_ns, data)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)

    def _header(self, stamp_ns: int, frame: str = _MAP) -> Any:
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        stamp = self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _quaternion(self, yaw_rad: float) -> Any:
        z, w = float(np.sin(yaw_rad / 2)), float(np.cos(yaw_rad / 2))
        return self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w)

    def _pose(self, x: float, y: float, yaw_rad: float) -> Any:
        point = self._make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)
        turn = self._quaternion(yaw_rad)
        return self._make("geometry_msgs/msg/Pose", position=point, orientation=turn)

    def _path(self, topic: str, path: Trajectory, stamp_ns: int) -> None:
        poses = [
            self._make(
                "geometry_msgs/msg/PoseStamped", header=self._header(at), pose=self._pose(*pose)
            )
            for at, pose in zip(path.stamps_ns.tolist(), path.poses.tolist(), strict=True)
        ]
        message = self._make("nav_msgs/msg/Path", header=self._header(stamp_ns), poses=poses)
        self._send(topic, "nav_msgs/msg/Path", message, stamp_ns)

    def _transforms(self, path: Trajectory) -> None:
        for stamp_ns, (x, y, yaw) in zip(path.stamps_ns.tolist(), path.poses.tolist(), strict=True):
            shift = self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=0.0)
            moved = self._make(
                "geometry_msgs/msg/Transform", translation=shift, rotation=self._quaternion(yaw)
            )
            stamped = self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(stamp_ns),
                child_frame_id=_ROBOT,
                transform=moved,
            )
            kind = "tf2_msgs/msg/TFMessage"
            self._send("/tf", kind, self._make(kind, transforms=[stamped]), stamp_ns)

    def _grid(self, topic: str, geometry: GridGeometry, values: Any, stamp_ns: int) -> None:
        info = self._make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self._header(stamp_ns).stamp,
            resolution=geometry.resolution_m,
            width=geometry.cols,
            height=geometry.rows,
            origin=self._pose(geometry.origin_x_m, geometry.origin_y_m, 0.0),
        )
        message = self._make(
            "nav_msgs/msg/OccupancyGrid",
            header=self._header(stamp_ns),
            info=info,
            data=np.ascontiguousarray(values, dtype=np.int8).ravel(),
        )
        self._send(topic, "nav_msgs/msg/OccupancyGrid", message, stamp_ns)

    def _radio(self, radio: RadioMap, stamp_ns: int) -> None:
        low, high = radio.gain_span_db()
        names = _topic_names([ap.name for ap in radio.access_points])
        for index, name in enumerate(names):
            gain_db = radio.channel_power_gain_db[index]
            known = np.isfinite(gain_db)
            share = (np.where(known, gain_db, low) - low) / max(high - low, 1e-9)
            values = np.where(known, np.round(100.0 * share), _UNKNOWN)
            self._grid(f"/radio/{name}", radio.geometry, values, stamp_ns)
            self._cloud(f"/radio/{name}/points", radio, index, stamp_ns)

    def _cloud(self, topic: str, radio: RadioMap, index: int, stamp_ns: int) -> None:
        gain_db = radio.channel_power_gain_db[index]
        known = np.isfinite(gain_db)
        places = radio.geometry.centers()[known]
        names = ("x", "y", "z", "gain_db", "path_loss_db", "line_of_sight")
        height_m = np.full(len(places), radio.antenna_height_m)
        sight = radio.line_of_sight[index][known]
        columns = (*places.T, height_m, gain_db[known], radio.path_loss_db[index][known], sight)
        points = np.column_stack(columns).astype("<f4")
        fields = [
            self._make("sensor_msgs/msg/PointField", name=n, offset=4 * i, datatype=7, count=1)
            for i, n in enumerate(names)
        ]
        message = self._make(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(stamp_ns),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=4 * len(names),
            row_step=4 * len(names) * len(points),
            data=np.frombuffer(points.tobytes(), dtype=np.uint8),
            is_dense=True,
        )
        self._send(topic, "sensor_msgs/msg/PointCloud2", message, stamp_ns)


def _values_of(grid: OccupancyGrid) -> Any:
    values = np.full(grid.geometry.shape, _UNKNOWN, dtype=np.int8)
    values[grid.free], values[grid.occupied] = 0, 100
    return values


def _topic_names(names: Sequence[str]) -> list[str]:
    """Return parts of topics, each once, as ROS 2 allows them: ASCII, and no digit in front."""
    found: list[str] = []
    for number, name in enumerate(names, start=1):
        word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        word = word if word[:1].isalpha() else f"ap_{word or number}"
        while word in found:
            word = f"{word}_{number}"
        found.append(word)
    return found
