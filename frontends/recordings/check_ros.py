# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnose what a ROS recording holds, topic by topic: scans, odometry, tf, inertial sensor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.check_scans import check_scans
from slarm_graph.frontends.recordings.check_time import Jumps, check_order, check_stamps
from slarm_graph.frontends.recordings.findings import (
    WARNING,
    Finding,
    Look,
    TopicFacts,
    counted,
    topic_facts,
)
from slarm_graph.frontends.recordings.frames import most_common_frame, only_segment
from slarm_graph.frontends.recordings.messages import (
    ODOMETRY,
    SCAN_TYPES,
    TF_TYPES,
    StampedTransforms,
    decode,
)
from slarm_graph.frontends.recordings.odometry import path_from_messages, places
from slarm_graph.frontends.recordings.packed import Cursor, Ints, Malformed
from slarm_graph.frontends.recordings.recordings import Recording, Topic
from slarm_graph.frontends.recordings.ros_source import RosMessages, read_messages
from slarm_graph.frontends.recordings.rosbag import open_recording
from slarm_graph.frontends.recordings.rotations import usable_quaternions
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.frontends.recordings.scan_units import in_si_units
from slarm_graph.frontends.recordings.transforms import TORN, TransformTree, torn
from slarm_graph.geometry import Floats, between

_IMU = "sensor_msgs/msg/Imu"

_FASTEST_M_S, _FASTEST_RAD_S = 5.0, 10.0
"""Fastest plausible motion: a choice, several times that of indoor robots; only for a warning."""
_LEAST_STEP_S = 0.1
"""Least duration of a step for its speed: messages stamped in bunches are no leaps."""


def check_topics(paths: Sequence[Path], config: SourceConfig) -> Look:
    """Read every relevant topic and return its findings."""
    recording = open_recording(paths)
    kinds = (*SCAN_TYPES, *TF_TYPES, ODOMETRY)
    looked_at = [topic for topic in recording.topics if topic.msgtype in kinds]
    messages = read_messages(recording, looked_at, echo=config.echo)
    notices = (*recording.notices, *messages.notices)
    findings = [Finding("warning", "file", notice.removeprefix(WARNING)) for notice in notices]
    for name, blocks in messages.scans.items():
        units = config.range_unit_m, config.angle_unit_rad
        measured = [in_si_units(block, *units) for block in blocks]
        findings += check_scans(name, measured, config) if measured else []
    jumps = _jumps(messages, config)
    for name, odometry in messages.odometry.items():
        findings += _check_odometry(name, _chosen(odometry, jumps), jumps)
    for space, (moving, fixed) in messages.tf_of.items():
        where = f"{space}/tf".lstrip("/") if space else "tf"
        findings += _check_tf(where, _chosen(moving, jumps), fixed, jumps)
    findings += _check_shared_frames(messages)
    for topic in recording.topics:
        if topic.msgtype == _IMU:
            findings += _check_imu_topic(recording, topic)
    findings += _check_signals(paths, config)
    facts = tuple(_facts(topic, messages) for topic in recording.topics)
    return Look(findings, recording.description, facts)


def _jumps(messages: RosMessages, config: SourceConfig) -> Jumps:
    """Return the clock jumps of the scans: of the chosen topic, else of the first."""
    wanted = f"/{(config.scan_topic or '').lstrip('/')}"
    blocks = messages.scans.get(wanted) or next(filter(None, messages.scans.values()), None)
    stamps = ScanTable(blocks).stamp_ns if blocks else np.zeros(0, np.int64)
    return Jumps.of_scans(stamps, config.segment)


def _chosen(part: StampedTransforms, jumps: Jumps) -> StampedTransforms:
    return part if jumps.chosen is None else only_segment(part, jumps.chosen, jumps.parts)


def _facts(topic: Topic, messages: RosMessages) -> TopicFacts:
    stamps: Ints | None = None
    frame = ""
    if topic.msgtype in SCAN_TYPES and messages.scans.get(topic.name):
        blocks = messages.scans[topic.name]
        stamps = np.concatenate([block.stamp_ns for block in blocks])
        frame = most_common_frame(blocks)
    elif topic.msgtype == ODOMETRY and len(messages.odometry[topic.name]):
        odometry = messages.odometry[topic.name]
        stamps, frame = odometry.stamp_ns, " -> ".join(odometry.edges[0])
    return topic_facts(topic, stamps, frame)


def _check_shared_frames(messages: RosMessages) -> list[Finding]:
    frames = Counter(most_common_frame(blocks) for blocks in messages.scans.values() if blocks)
    return [
        Finding("warning", frame, f"{count} scan topics are in this frame", "one laser, two names?")
        for frame, count in frames.items()
        if count > 1
    ]


def _check_signals(paths: Sequence[Path], config: SourceConfig) -> list[Finding]:
    """Return notes on signal strength that a run uses, or could use."""
    from slarm_graph.frontends.signals.rss_found import found_rss

    return [
        Finding("note", found.topic, found.what_it_is(), found.advice())
        for found in found_rss(paths, config.ros_distro)
    ]


def _check_imu_topic(recording: Recording, topic: Topic) -> list[Finding]:
    try:
        parts = [
            part
            for _, packed in recording.read([topic])
            for part in decode([packed], _read_accelerations, cdr=recording.cdr)
        ]
    except Malformed as error:
        return [Finding("note", topic.name, str(error))]
    return _check_imu(topic.name, np.concatenate(parts)) if parts else []


def _check_odometry(where: str, messages: StampedTransforms, jumps: Jumps) -> list[Finding]:
    """Check an odometry topic; its poses only where they are of one recording."""
    if len(messages) == 0:
        return [Finding("warning", where, "has no messages")]
    found = check_stamps(where, messages.stamp_ns, messages.record_ns, jumps)
    if any(finding.severity == "error" for finding in found):
        return found
    if torn(messages.translations_m):
        found.append(Finding("error", where, f"the pose {TORN}", "choose with --odom, or none"))
    path, useless = path_from_messages(messages)
    found += _told_poses(where, messages, useless)
    if any(not child for _, child in messages.edges):
        told = "child_frame_id is empty: the robot's frame is guessed"
        found.append(Finding("note", where, told, "set --set source.robot_frame=..."))
    if path.never_moves():
        told = "the pose never changes"
        found.append(Finding("warning", where, told, "wheel encoders connected? else --odom none"))
    if len(path) > 1:
        steps = np.abs(between(path.poses[:-1], path.poses[1:]))
        seconds = np.maximum(np.diff(path.stamp_ns) * 1e-9, _LEAST_STEP_S)
        leaps = (np.hypot(steps[:, 0], steps[:, 1]) > _FASTEST_M_S * seconds) | (
            steps[:, 2] > _FASTEST_RAD_S * seconds
        )
        found += counted(
            "warning", where, f"leaps faster than {_FASTEST_M_S:g} m/s: {{count}}", leaps,
            path.stamp_ns[1:], "odometry was reset, or corrected by another SLAM",
        )  # fmt: skip
    return found


def _check_poses(where: str, messages: StampedTransforms) -> list[Finding]:
    usable, _ = usable_quaternions(messages.quaternions)
    return _told_poses(where, messages, ~(usable & places(messages.translations_m)))


def _told_poses(where: str, messages: StampedTransforms, bad: NDArray[np.bool_]) -> list[Finding]:
    return counted(
        "error" if bad.all() else "warning", where,
        "{count} of {total} poses invalid (nowhere, or not a unit quaternion)", bad,
        messages.stamp_ns, "they are not used" if not bad.all() else "use --odom none",
    )  # fmt: skip


def _check_tf(
    where: str, moving: StampedTransforms, fixed: StampedTransforms, jumps: Jumps
) -> list[Finding]:
    """Check all transforms of one namespace."""
    found = _check_poses(where, moving) + _check_poses(f"{where}_static", fixed)
    tree = TransformTree([moving], [fixed])
    found += [Finding("warning", where, told.removeprefix("warning: ")) for told in tree.notices()]
    for parent, child in tree.pairs():
        if parent == "map":
            told = f"{parent} -> {child} is almost always the output of another SLAM"
            found.append(Finding("note", where, told, "it is ignored"))
    for child in sorted({child for _, child in tree.pairs()}):
        parents = sorted(parent for parent, other in tree.pairs() if other == child)
        if len(parents) > 1:
            told = f"{child} has several parents: {', '.join(parents)}"
            found.append(
                Finding("warning", where, told, "a frame has one parent (REP-105); stop one")
            )
    for pair in tree.pairs():
        found += _check_edge(where, tree, moving, pair, jumps)
    return found


def _check_edge(
    where: str,
    tree: TransformTree,
    moving: StampedTransforms,
    pair: tuple[str, str],
    jumps: Jumps,
) -> list[Finding]:
    where = f"{where} {pair[0]} -> {pair[1]}"
    try:
        if tree.edge(pair).is_static or pair not in moving.edges:
            return []
    except BadInput:
        return [Finding("error", where, TORN, "choose with --odom")]
    return check_order(where, moving.stamp_ns[moving.edge == moving.edges.index(pair)], jumps)


def _read_accelerations(cursor: Cursor) -> Floats:
    """Decode sensor_msgs/Imu: linear accelerations (N, 3) [m/s^2]."""
    cursor.column("u4", 2 if cursor.cdr else 3)
    cursor.strings()
    return np.asarray(cursor.column("f8", 37), np.float64)[:, 25:28]


def _check_imu(where: str, accelerations: Floats) -> list[Finding]:
    """Check that gravity is in the accelerations, in m/s^2 (cartographer's rule)."""
    norms = np.linalg.norm(accelerations, axis=1)
    if len(norms) == 0:
        return []
    usual = float(np.median(norms))
    if 9.5 <= usual <= 10.5 and np.all((norms > 3.0) & (norms < 30.0)):
        return []
    told = f"|acceleration| is {norms.min():.2f} ... {norms.max():.2f}, usually {usual:.2f} m/s^2"
    return [
        Finding("note", where, told, "9.5 ... 10.5 is expected with gravity; the IMU is not used")
    ]
