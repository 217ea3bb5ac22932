# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnose what a ROS recording holds, topic by topic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.frontends.recordings.check_motion import (
    IMU,
    check_imu,
    check_odometry,
    check_tf,
    read_accelerations,
)
from slarm_graph.frontends.recordings.check_scans import check_scans
from slarm_graph.frontends.recordings.findings import (
    WARNING,
    Finding,
    Look,
    TopicFacts,
    topic_facts,
)
from slarm_graph.frontends.recordings.frames import usual_frame
from slarm_graph.frontends.recordings.messages import ODOMETRY, SCAN_TYPES, TF_TYPES, decode
from slarm_graph.frontends.recordings.packed import Ints, Malformed
from slarm_graph.frontends.recordings.recordings import Recording, Topic
from slarm_graph.frontends.recordings.ros_source import RosMessages, read_messages
from slarm_graph.frontends.recordings.rosbag import open_recording
from slarm_graph.frontends.recordings.scan_units import in_si_units


def look_into(paths: Sequence[Path], config: SourceConfig) -> Look:
    """Read every topic that matters and tell what is wrong with it."""
    recording = open_recording(paths)
    kinds = (*SCAN_TYPES, *TF_TYPES, ODOMETRY)
    looked_at = [topic for topic in recording.topics if topic.msgtype in kinds]
    messages = read_messages(recording, looked_at, echo=config.echo)
    notices = (*recording.notices, *messages.notices)
    findings = [Finding("warning", "file", notice.removeprefix(WARNING)) for notice in notices]
    for name, blocks in messages.scans.items():
        units = config.range_unit_m, config.angle_unit_rad
        measured = [in_si_units(block, *units) for block in blocks]
        findings += check_scans(name, measured) if measured else []
    for name, odometry in messages.odometry.items():
        findings += check_odometry(name, odometry)
    for space, (moving, fixed) in messages.tf_of.items():
        findings += check_tf(f"{space}/tf".lstrip("/") if space else "tf", moving, fixed)
    findings += _check_shared_frames(messages)
    for topic in recording.topics:
        if topic.msgtype == IMU:
            findings += _check_imu_topic(recording, topic)
    facts = tuple(_facts(topic, messages) for topic in recording.topics)
    return Look(findings, recording.description, facts)


def _facts(topic: Topic, messages: RosMessages) -> TopicFacts:
    stamps: Ints | None = None
    frame = ""
    if topic.msgtype in SCAN_TYPES and messages.scans.get(topic.name):
        blocks = messages.scans[topic.name]
        stamps = np.concatenate([block.stamp_ns for block in blocks])
        frame = usual_frame(blocks)
    elif topic.msgtype == ODOMETRY and len(messages.odometry[topic.name]):
        odometry = messages.odometry[topic.name]
        stamps, frame = odometry.stamp_ns, " -> ".join(odometry.edges[0])
    return topic_facts(topic, stamps, frame)


def _check_shared_frames(messages: RosMessages) -> list[Finding]:
    frames = Counter(usual_frame(blocks) for blocks in messages.scans.values() if blocks)
    return [
        Finding("warning", frame, f"{count} scan topics are in this frame", "one laser, two names?")
        for frame, count in frames.items()
        if count > 1
    ]


def _check_imu_topic(recording: Recording, topic: Topic) -> list[Finding]:
    try:
        parts = [
            part
            for _, packed in recording.read([topic])
            for part in decode([packed], read_accelerations, cdr=recording.cdr)
        ]
    except Malformed as error:
        return [Finding("note", topic.name, str(error))]
    return check_imu(topic.name, np.concatenate(parts)) if parts else []
