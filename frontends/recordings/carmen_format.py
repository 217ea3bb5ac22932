# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The recording format `carmen`: opening, checking and writing CARMEN logs."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from slarm_graph.config import SourceConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.carmen import CARMEN_ENDINGS, looks_like_carmen, read_carmen
from slarm_graph.frontends.recordings.carmen_lines import LASERS
from slarm_graph.frontends.recordings.check_scans import check_scans
from slarm_graph.frontends.recordings.clock import segment_rows, segments
from slarm_graph.frontends.recordings.findings import Finding, Look, TopicFacts, topic_facts
from slarm_graph.frontends.recordings.mounting import Mounting
from slarm_graph.frontends.recordings.odometry import sorted_path
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.recorded_source import RecordedSource, fixed
from slarm_graph.frontends.recordings.recordings import Topic, rate_hz
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading

_HOST = "slarm"


class Carmen:
    """CARMEN log, plain or gzipped: scans with the odometry logged beside them."""

    settings: ClassVar[type[Stage]] = Stage
    endings = CARMEN_ENDINGS

    def __init__(self, settings: Stage) -> None:
        del settings

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Whether one of the files is a log, by its first lines."""
        return any(_is_log(path) for path in paths)

    def open(self, paths: Sequence[Path], config: SourceConfig) -> RecordedSource:
        """Open one log."""
        if len(paths) > 1:
            log = next(path for path in paths if _is_log(path))
            raise BadInput(f"{log} is a CARMEN log; only one at a time can be read")
        return open_carmen(paths[0], config)

    def check(self, paths: Sequence[Path], config: SourceConfig) -> Look:
        """Check the scans and count the lines."""
        log = read_carmen(paths[0])
        findings = [Finding("warning", "file", notice) for notice in log.notices]
        for name, blocks in log.scans.items():
            findings += check_scans(name, blocks, config)
        stamps = {name: ScanTable(blocks).stamp_ns for name, blocks in log.scans.items()}
        facts = [_facts(*item) for item in (*stamps.items(), ("ODOM", log.odom_stamp_ns))]
        return Look(findings, f"CARMEN log {paths[0].name}", tuple(facts))

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Write readings as ROBOTLASER1 lines (RAWLASER1 where there is no odometry).

        Beams without a return are written just beyond the maximum range, as CARMEN's drivers do;
        whether the way was clear or the beam invalid is lost.
        """
        opener = gzip.open if destination.name.endswith(".gz") else open
        count, start_ns = 0, None
        with opener(destination, "wt", encoding="ascii") as file:
            file.write("# CARMEN Logfile\n# written by slarm-graph\n")
            for reading in readings:
                start_ns = reading.stamp_ns if start_ns is None else start_ns
                file.write(_line(reading, start_ns))
                count += 1
        return count


def _is_log(path: Path) -> bool:
    return path.is_file() and path.name != "metadata.yaml" and looks_like_carmen(path)


def _facts(name: str, stamps: Ints) -> TopicFacts:
    parts = [(len(stamps), (int(stamps.min()), int(stamps.max())))] if len(stamps) else []
    return topic_facts(Topic(name, "CARMEN", len(stamps), rate_hz(parts)), stamps)


def open_carmen(path: Path, config: SourceConfig) -> RecordedSource:
    """Open a CARMEN log: scans with the odometry logged beside them."""
    log = read_carmen(path)
    name = config.scan_topic or next(laser for laser in LASERS if laser in log.scans)
    if name not in log.scans:
        raise BadInput(f"{path} has no {name} lines; it has {', '.join(log.scans)}")
    notices = list(log.notices)
    if len(log.scans) > 1 and config.scan_topic is None:
        others = ", ".join(other for other in log.scans if other != name)
        notices.append(f"using {name}; choose another with --scan ({others})")
    mounting = Mounting(Pose2.from_array(log.robot_from_laser[name]))
    table, odometry = ScanTable(log.scans[name]), None
    if any(block.odom_from_robot is None for block in table.blocks) and config.odom != "none":
        rows = np.arange(len(log.odom_stamp_ns))
        if config.segment is not None:
            count = len(segments(table.stamp_ns))
            rows = segment_rows(log.odom_stamp_ns, config.segment, count)
        odometry = sorted_path(log.odom_stamp_ns[rows], log.odom_poses[rows])

    return RecordedSource(
        table,
        odometry,
        fixed(mounting),
        config=config,
        topic=f"{path.name} {name}",
        description=f"CARMEN log {path.name}",
        notices=notices,
    )


def _line(reading: Reading, start_ns: int) -> str:
    scan = reading.scan
    beams, step = len(scan.ranges_m), scan.angle_increment_rad
    ranges = np.where(scan.is_return(), scan.ranges_m, scan.range_max_m + 0.01)
    head = [0, repr(scan.angle_min_rad), repr(step * max(beams - 1, 0)), repr(step)]
    head += [repr(scan.range_max_m), 0.01, 0, beams]
    name, poses = "RAWLASER1", []
    if reading.odom_from_robot is not None:
        name = "ROBOTLASER1"
        laser = reading.odom_from_robot @ scan.robot_from_laser
        poses = [*_pose(laser), *_pose(reading.odom_from_robot), 0, 0, 0, 0, 0]
    told = [f"{value:.4f}".rstrip("0").rstrip(".") for value in ranges.tolist()]
    seconds, rest = divmod(reading.stamp_ns, 1_000_000_000)
    since = (reading.stamp_ns - start_ns) * 1e-9
    tail = [f"{seconds}.{rest:09d}", _HOST, f"{since:.6f}"]
    return " ".join(map(str, [name, *head, *told, 0, *poses, *tail])) + "\n"


def _pose(pose: Pose2) -> list[str]:
    if not all(map(math.isfinite, (pose.x, pose.y, pose.theta))):
        raise BadInput(f"a pose is not finite: {pose}")
    return [f"{value:.9f}" for value in (pose.x, pose.y, pose.theta)]
