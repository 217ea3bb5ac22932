# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Reading recordings into readings, against rosbags' AnyReader + deserialize in the same run.

    pytest benchmarks/bench_reading.py --benchmark-only -m ''

Both sides do the same topics of the same file in turn, several times; the ratio is that of the
best times. Ours goes further: it also reads tf, cleans the ranges and interpolates the odometry.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from slarm_graph.config import SourceConfig
from slarm_graph.frontends.recordings.sources import open_source

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
ROUNDS = 5
"""Of both readers in turn; the best of each counts, as what else runs only ever adds time."""
STORE = get_typestore(Stores.ROS1_NOETIC)


def with_rosbags(path: Path, topics: set[str]) -> int:
    """Read and deserialize every message of some topics; the baseline."""
    count = 0
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        wanted = [c for c in reader.connections if c.topic in topics]
        for connection, _, raw in reader.messages(wanted):
            reader.deserialize(raw, connection.msgtype)
            count += 1
    return count


def with_slarm(path: Path) -> int:
    """Make readings of the recording."""
    return sum(1 for _ in open_source(path, SourceConfig()))


def timed(work: Callable[[], int]) -> tuple[float, float]:
    """Wall and processor time of one call [s]."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def compare(benchmark, path: Path, topics: set[str]) -> None:
    """Time both in turn and print the ratio to the baseline."""
    with_slarm(path)
    theirs, ours = [], []
    for _ in range(ROUNDS):
        theirs.append(timed(lambda: with_rosbags(path, topics)))
        ours.append(timed(lambda: with_slarm(path)))
    (their_wall, their_cpu), (our_wall, our_cpu) = np.min(theirs, axis=0), np.min(ours, axis=0)
    benchmark.extra_info["baseline"] = "rosbags AnyReader + deserialize"
    benchmark.extra_info["times_as_fast_wall"] = float(their_wall / our_wall)
    benchmark.extra_info["times_as_fast_cpu"] = float(their_cpu / our_cpu)
    print(
        f"\n{path.name}: rosbags {their_wall:.3f} s wall {their_cpu:.3f} s cpu, "
        f"slarm {our_wall:.3f} s wall {our_cpu:.3f} s cpu: "
        f"{their_wall / our_wall:.2f} x as fast (wall), {their_cpu / our_cpu:.2f} x (cpu)"
    )
    benchmark.pedantic(with_slarm, args=(path,), rounds=3)


@pytest.mark.parametrize("name", ["intel", "fr079", "mit-csail"])
def test_reading_a_ros1_bag(benchmark, name: str) -> None:
    path = SHARED_DATA / "benchmark" / f"{name}.bag"
    if not path.exists():
        pytest.skip(f"no recording at {path}")
    compare(benchmark, path, {"/scan", "/odom"})


@pytest.mark.parametrize("name", ["mit-csail_db3", "dec13_target_before_mcap"])
def test_reading_a_ros2_bag(benchmark, name: str) -> None:
    path = SHARED_DATA / "ros2" / name
    if not path.exists():
        pytest.skip(f"no recording at {path}")
    compare(benchmark, path, {"/scan", "/odom"})


@pytest.fixture(scope="module")
def multi_echo_bag(tmp_path_factory) -> Path:
    """Make 200 scans of 1080 beams with up to three echoes each."""
    t, rng = STORE.types, np.random.default_rng(0)
    echo, kind = t["sensor_msgs/msg/LaserEcho"], "sensor_msgs/msg/MultiEchoLaserScan"
    path = tmp_path_factory.mktemp("bench") / "multi_echo.bag"
    with Writer(path) as writer:
        connection = writer.add_connection("/scan", kind, typestore=STORE)
        for number in range(200):
            stamp = t["builtin_interfaces/msg/Time"](100 + number // 10, number % 10 * 10**8)
            lists = [
                [
                    echo(rng.uniform(0.5, 9.0, n).astype(np.float32))
                    for n in rng.integers(0, 4, 1080)
                ]
                for _ in range(2)
            ]
            header = t["std_msgs/msg/Header"](number, stamp, "laser")
            message = t[kind](header, -2.3, 2.3, 0.00426, 0.0, 0.1, 0.1, 30.0, *lists)
            time_ns = stamp.sec * 10**9 + stamp.nanosec
            writer.write(connection, time_ns, STORE.serialize_ros1(message, kind))
    return path


def test_reading_multi_echo_scans(benchmark, multi_echo_bag: Path) -> None:
    compare(benchmark, multi_echo_bag, {"/scan"})
