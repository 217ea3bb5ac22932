# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnose a recording before it is used: most bad maps come from bad recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.carmen import read_carmen
from slarm_graph.frontends.recordings.check_motion import (
    IMU,
    check_imu,
    check_odometry,
    check_tf,
    read_accelerations,
)
from slarm_graph.frontends.recordings.check_scans import check_scans
from slarm_graph.frontends.recordings.findings import (
    Diagnosis,
    Finding,
    Severity,
    TopicFacts,
    step_histogram,
)
from slarm_graph.frontends.recordings.formats import Sections, format_of
from slarm_graph.frontends.recordings.frames import usual_frame
from slarm_graph.frontends.recordings.messages import (
    ODOMETRY,
    SCAN_TYPES,
    TF_TYPES,
    ScanBlock,
    decode,
)
from slarm_graph.frontends.recordings.packed import Ints, Malformed
from slarm_graph.frontends.recordings.recordings import Recording, Topic
from slarm_graph.frontends.recordings.ros_source import RosMessages, read_messages
from slarm_graph.frontends.recordings.rosbag import open_recording
from slarm_graph.frontends.recordings.sources import (
    existing_paths,
    is_carmen,
    open_source,
    open_world,
)

WARNING = "warning: "
"""Begins the notices of a source that are more than notes."""
_ORDER = {"error": 0, "warning": 1, "note": 2}


def check(
    paths: Sequence[Path | str] | Path | str,
    config: SourceConfig | None = None,
    section: Sections | None = None,
) -> Diagnosis:
    """Diagnose a recording; never raises, whatever the file.

    Parameters
    ----------
    paths : path or sequence of paths
    config : SourceConfig, optional
        As the run would use it.
    section : callable, optional
        As for `open_source`.

    Returns
    -------
    Diagnosis
    """
    config = config or SourceConfig()
    name = ", ".join(str(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths))
    description = name
    topics: tuple[TopicFacts, ...] = ()
    findings: list[Finding] = []
    readings = 0
    try:
        files = existing_paths(paths)
        theirs = format_of(files, section)
        if theirs is None:
            description, topics, findings = _look(files, config)
        else:
            findings = list(theirs.check(files, config))
        source = open_source(files, config, section=section)
        readings = len(list(source))
        findings += _as_used(source.info().notices, findings)
    except BadInput as error:
        findings.append(Finding("error", "recording", str(error)))
    except Exception as error:  # a diagnosis has to end in words on any file
        told = f"{type(error).__name__}: {error}"
        findings.append(
            Finding("error", "recording", told, "the file is damaged in a way not foreseen")
        )
    ordered = sorted(findings, key=lambda finding: _ORDER[finding.severity])
    return Diagnosis(description, topics, tuple(ordered), readings)


def _as_used(notices: Sequence[str], findings: Sequence[Finding]) -> list[Finding]:
    """What a run would be told besides what was found; a warning there is one here."""
    known = {finding.what for finding in findings}
    used = []
    for notice in notices:
        text = notice.removeprefix(WARNING)
        severity: Severity = "note" if text == notice else "warning"
        if not any(what in text for what in known):
            used.append(Finding(severity, "as used", text))
    return used


Look = tuple[str, tuple[TopicFacts, ...], list[Finding]]


def _look(files: Sequence[Path], config: SourceConfig) -> Look:
    """Look into what the kind of file holds; a world holds no messages that could be wrong."""
    if is_carmen(files[0]):
        return _check_carmen(files, config)
    world = open_world(files)
    return _check_ros(files, config) if world is None else (world.info().description, (), [])


def _check_ros(files: Sequence[Path], config: SourceConfig) -> Look:
    recording = open_recording(files)
    kinds = (*SCAN_TYPES, *TF_TYPES, ODOMETRY)
    looked_at = [topic for topic in recording.topics if topic.msgtype in kinds]
    messages = read_messages(recording, looked_at, echo=config.echo)
    notices = (*recording.notices, *messages.notices)
    findings = [Finding("warning", "file", notice.removeprefix(WARNING)) for notice in notices]
    for name, blocks in messages.scans.items():
        findings += check_scans(name, blocks) if blocks else []
    for name, odometry in messages.odometry.items():
        findings += check_odometry(name, odometry)
    for space, (moving, fixed) in messages.tf_of.items():
        findings += check_tf(f"{space}/tf".lstrip("/") if space else "tf", moving, fixed)
    findings += _check_shared_frames(messages)
    for topic in recording.topics:
        if topic.msgtype == IMU:
            findings += _check_imu_topic(recording, topic)
    facts = tuple(_facts(topic, messages) for topic in recording.topics)
    return recording.description, facts, findings


def _facts(topic: Topic, messages: RosMessages) -> TopicFacts:
    stamps: Ints | None = None
    frame = ""
    if topic.msgtype in SCAN_TYPES and messages.scans.get(topic.name):
        blocks = messages.scans[topic.name]
        stamps, frame = np.sort(_stamps(blocks)), usual_frame(blocks)
    elif topic.msgtype == ODOMETRY and len(messages.odometry[topic.name]):
        odometry = messages.odometry[topic.name]
        stamps, frame = np.sort(odometry.stamp_ns), " -> ".join(odometry.edges[0])
    return _told(topic, stamps, frame)


def _told(topic: Topic, stamps: Ints | None, frame: str) -> TopicFacts:
    """Put a topic's sorted stamps into numbers."""
    if stamps is None or not len(stamps):
        return TopicFacts(topic.name, topic.msgtype, topic.count, topic.rate_hz)
    return TopicFacts(
        topic.name, topic.msgtype, topic.count, topic.rate_hz, frame,
        int(stamps[0]), int(stamps[-1]), step_histogram(stamps),
    )  # fmt: skip


def _stamps(blocks: Sequence[ScanBlock]) -> Ints:
    return np.concatenate([block.stamp_ns for block in blocks])


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


def _check_carmen(files: Sequence[Path], config: SourceConfig) -> Look:
    log = read_carmen(files[0])
    findings = [Finding("warning", "file", notice) for notice in log.notices]
    facts = []
    for name, blocks in log.scans.items():
        findings += check_scans(name, blocks)
        stamps = np.sort(_stamps(blocks))
        facts.append(_told(Topic(name, "CARMEN", len(stamps), _rate_hz(stamps)), stamps, ""))
    stamps = np.sort(log.odom_stamp_ns)
    facts.append(_told(Topic("ODOM", "CARMEN", len(stamps), _rate_hz(stamps)), stamps, ""))
    return f"CARMEN log {files[0].name}", tuple(facts), findings


def _rate_hz(stamps: Ints) -> float:
    span_s = float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0
    return (len(stamps) - 1) / span_s if span_s > 0 else 0.0
