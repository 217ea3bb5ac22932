# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A run's results as a ROS 2 recording, for Foxglove and RViz: path, maps, tf, radio map."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.files.maps import read_map
from slarm_graph.files.trajectories import read_trajectory, trajectory_file
from slarm_graph.frontends.recordings.ros_writing import BagWriter, open_new_bag
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.files import read_radio_npz
from slarm_graph.trajectory import Trajectory

_MAP, _ROBOT = "map", "base_link"
_UNKNOWN = -1
"""Value of unknown cells in nav_msgs/OccupancyGrid."""


def write_results_mcap(run: Path, target: Path) -> None:
    """Write /path, /ground_truth, /tf, /map, /geographic_map and, per access point, /radio/NAME.

    A radio map is an OccupancyGrid (0 weakest, 100 strongest gain) and a PointCloud2 with the gain
    [dB], the path loss [dB] and line of sight of every cell.
    """
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".writing-") as folder:
        made = Path(folder) / "results.mcap"
        with open_new_bag(made) as bag:
            _write(bag, run)
        shutil.move(made, target)


def _write(bag: BagWriter, run: Path) -> None:
    """Write all results in the run folder."""
    path = read_trajectory(trajectory_file(run))
    start_ns, end_ns = int(path.stamps_ns[0]), int(path.stamps_ns[-1])
    _path(bag, "/path", path, end_ns)
    if (run / "ground_truth.tum").is_file():
        _path(bag, "/ground_truth", read_trajectory(run / "ground_truth.tum"), end_ns)
    for stamp_ns, pose in _stamped(path):
        bag.transform("/tf", stamp_ns, _MAP, _ROBOT, pose)
    for name in ("map", "geographic_map"):
        if (run / f"{name}.yaml").is_file():
            grid = read_map(run / f"{name}.yaml")
            _grid(bag, f"/{name}", grid.geometry, _values_of(grid), start_ns)
    if (run / "radio_map.npz").is_file():
        _radio(bag, read_radio_npz(run / "radio_map.npz"), start_ns)


def _stamped(path: Trajectory) -> Iterator[tuple[int, Pose2]]:
    return zip(path.stamps_ns.tolist(), map(Pose2.from_array, path.poses), strict=True)


def _path(bag: BagWriter, topic: str, path: Trajectory, stamp_ns: int) -> None:
    poses = [
        bag.make("geometry_msgs/msg/PoseStamped", bag.header(at, _MAP), bag.pose_message(pose))
        for at, pose in _stamped(path)
    ]
    message = bag.make("nav_msgs/msg/Path", bag.header(stamp_ns, _MAP), poses)
    bag.send(topic, stamp_ns, message, "nav_msgs/msg/Path")


def _grid(bag: BagWriter, topic: str, geometry: GridGeometry, values: Any, stamp_ns: int) -> None:
    header = bag.header(stamp_ns, _MAP)
    info = bag.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=header.stamp,
        resolution=geometry.resolution_m,
        width=geometry.cols,
        height=geometry.rows,
        origin=bag.pose_message(Pose2(geometry.origin_x_m, geometry.origin_y_m)),
    )
    data = np.ascontiguousarray(values, dtype=np.int8).ravel()
    message = bag.make("nav_msgs/msg/OccupancyGrid", header, info, data)
    bag.send(topic, stamp_ns, message, "nav_msgs/msg/OccupancyGrid")


def _radio(bag: BagWriter, radio: RadioMap, stamp_ns: int) -> None:
    low, high = radio.gain_span_db()
    names = _topic_names([ap.name for ap in radio.access_points])
    for index, name in enumerate(names):
        gain_db = radio.channel_power_gain_db[index]
        known = np.isfinite(gain_db)
        share = (np.where(known, gain_db, low) - low) / max(high - low, 1e-9)
        values = np.where(known, np.round(100.0 * share), _UNKNOWN)
        _grid(bag, f"/radio/{name}", radio.geometry, values, stamp_ns)
        _cloud(bag, f"/radio/{name}/points", radio, index, stamp_ns)


def _cloud(bag: BagWriter, topic: str, radio: RadioMap, index: int, stamp_ns: int) -> None:
    gain_db = radio.channel_power_gain_db[index]
    known = np.isfinite(gain_db)
    places = radio.geometry.centers()[known]
    names = ("x", "y", "z", "gain_db", "path_loss_db", "line_of_sight")
    height_m = np.full(len(places), radio.antenna_height_m)
    sight = radio.line_of_sight[index][known]
    columns = (*places.T, height_m, gain_db[known], radio.path_loss_db[index][known], sight)
    points = np.column_stack(columns).astype("<f4")
    fields = [
        bag.make("sensor_msgs/msg/PointField", name=n, offset=4 * i, datatype=7, count=1)
        for i, n in enumerate(names)
    ]
    message = bag.make(
        "sensor_msgs/msg/PointCloud2",
        header=bag.header(stamp_ns, _MAP),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=4 * len(names),
        row_step=4 * len(names) * len(points),
        data=np.frombuffer(points.tobytes(), dtype=np.uint8),
        is_dense=True,
    )
    bag.send(topic, stamp_ns, message, "sensor_msgs/msg/PointCloud2")


def _values_of(grid: OccupancyGrid) -> Any:
    values = np.full(grid.geometry.shape, _UNKNOWN, dtype=np.int8)
    values[grid.free], values[grid.occupied] = 0, 100
    return values


def _topic_names(names: Sequence[str]) -> list[str]:
    """Return unique topic names that ROS 2 allows: ASCII, without a leading digit."""
    found: list[str] = []
    for number, name in enumerate(names, start=1):
        word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        word = word if word[:1].isalpha() else f"ap_{word or number}"
        while word in found:
            word = f"{word}_{number}"
        found.append(word)
    return found
