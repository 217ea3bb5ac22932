# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of topics and frames of a ROS recording, and its source of readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.clock import segments
from slarm_graph.frontends.recordings.frames import (
    build_tree,
    most_common_frame,
    mountings,
    odometry_of_topic,
    odometry_of_tree,
    only_segment,
    robot_frame,
    scans_change,
)
from slarm_graph.frontends.recordings.messages import (
    MULTI_ECHO,
    ODOMETRY,
    SCAN_TYPES,
    TF_TYPES,
    ScanBlock,
    StampedTransforms,
    decode,
    join_transforms,
    read_multi_echo,
    read_odometry,
    read_scans,
    read_transforms,
)
from slarm_graph.frontends.recordings.odometry import OdometryPath
from slarm_graph.frontends.recordings.packed import Cursor, Malformed, Packed
from slarm_graph.frontends.recordings.recorded_source import RecordedSource
from slarm_graph.frontends.recordings.recordings import Recording, Topic
from slarm_graph.frontends.recordings.rosbag import open_recording
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.frontends.recordings.topic_choice import (
    choose_odom_topic,
    choose_scan_topic,
    choose_tf_topics,
    namespace,
)
from slarm_graph.frontends.recordings.transforms import TransformTree

_STATIC_TOPIC = "/tf_static"

Columns = TypeVar("Columns")


@dataclass(slots=True)
class RosMessages:
    """The decoded topics of a recording.

    Parameters
    ----------
    scans : dict of topic name to list of ScanBlock
    odometry : dict of topic name to StampedTransforms
    moving, fixed : StampedTransforms
        From /tf and /tf_static.
    notices : list of str
    tf_of : dict of namespace to (moving, fixed)
        The same, by the namespace of the tf topic.
    """

    scans: dict[str, list[ScanBlock]]
    odometry: dict[str, StampedTransforms]
    moving: StampedTransforms
    fixed: StampedTransforms
    notices: list[str] = field(default_factory=list)
    tf_of: dict[str, tuple[StampedTransforms, StampedTransforms]] = field(default_factory=dict)


def open_ros(paths: Sequence[Path], config: SourceConfig) -> RecordedSource:
    """Open ROS recordings as one source of readings."""
    recording = open_recording(paths)
    scan_topic = choose_scan_topic(
        recording.topics, config.scan_topic, partial(first_frame, recording)
    )
    scans = [topic for topic in recording.topics if topic.msgtype in SCAN_TYPES]
    odom_topic, told = choose_odom_topic(recording.topics, config.odom, scan_topic, scans)
    published = [topic for topic in recording.topics if topic.msgtype in TF_TYPES]
    tf_topics, more = choose_tf_topics(published, scan_topic, scans, config.tf_namespace)
    told += more
    wanted = [scan_topic, *tf_topics, *([odom_topic] if odom_topic else [])]
    messages = read_messages(recording, wanted, echo=config.echo)
    messages.notices[:0] = told
    return _assemble(recording, messages, scan_topic, odom_topic, config)


def first_frame(recording: Recording, topic: Topic) -> str:
    """Return the frame of a scan topic's first message, `?` where it cannot be read."""
    for _, packed in recording.read([topic]):
        first = packed.subset(np.arange(min(1, len(packed))))
        try:
            blocks = _scans(topic, recording.cdr, "first", first)
        except Malformed:
            break
        return blocks[0].frame if blocks else "?"
    return "?"


def read_messages(
    recording: Recording, topics: Sequence[Topic], *, echo: str = "first"
) -> RosMessages:
    """Decode some topics of a recording in one pass over it; malformed messages are skipped."""
    scans: dict[str, list[ScanBlock]] = {}
    transforms: dict[Topic, list[StampedTransforms]] = {topic: [] for topic in topics}
    seen, malformed = dict.fromkeys(topics, 0), dict.fromkeys(topics, 0)
    for topic, packed in recording.read(topics):
        if topic.msgtype in SCAN_TYPES:
            found, bad = _tolerant(packed, partial(_scans, topic, recording.cdr, echo))
            blocks = scans.setdefault(topic.name, [])
            blocks += [replace(b, index=b.index + row + seen[topic]) for row, b in found]
        else:
            some, bad = _tolerant(packed, partial(_transforms, topic, recording.cdr))
            transforms[topic] += [part for _, part in some]
        seen[topic] += len(packed)
        malformed[topic] += bad
    tf = {topic: parts for topic, parts in transforms.items() if topic.msgtype in TF_TYPES}
    spaces = sorted({namespace(topic.name) for topic in tf})
    return RosMessages(
        scans,
        {t.name: join_transforms(p) for t, p in transforms.items() if t.msgtype == ODOMETRY},
        *_moving_and_fixed(tf),
        [f"{n} malformed messages in {topic.name} skipped" for topic, n in malformed.items() if n],
        {
            s: _moving_and_fixed({t: p for t, p in tf.items() if namespace(t.name) == s})
            for s in spaces
        },
    )


def _moving_and_fixed(
    tf: dict[Topic, list[StampedTransforms]],
) -> tuple[StampedTransforms, StampedTransforms]:
    """Join the transforms of topics: moving and static ones."""
    return (
        join_transforms([p for t, parts in tf.items() if not _is_static(t) for p in parts]),
        join_transforms([p for t, parts in tf.items() if _is_static(t) for p in parts]),
    )


def _tolerant(
    packed: Packed, read: Callable[[Packed], list[Columns]]
) -> tuple[list[tuple[int, Columns]], int]:
    """Decode a batch; if that fails, message by message, without those that fail.

    Returns
    -------
    list of (number of its first message, columns)
    int
        How many messages were left out.
    """
    try:
        return [(0, columns) for columns in read(packed)], 0
    except Malformed:
        good: list[tuple[int, Columns]] = []
        bad = 0
        for row in range(len(packed)):
            try:
                good += [(row, columns) for columns in read(packed.subset(np.array([row])))]
            except Malformed:
                bad += 1
        return good, bad


def _scans(topic: Topic, cdr: bool, echo: str, packed: Packed) -> list[ScanBlock]:
    def one(cursor: Cursor) -> list[ScanBlock]:
        """Read the messages of one chunk as this topic's type."""
        return read_multi_echo(cursor, echo) if topic.msgtype == MULTI_ECHO else read_scans(cursor)

    return [block for part in decode([packed], one, cdr=cdr) for block in part]


def _transforms(topic: Topic, cdr: bool, packed: Packed) -> list[StampedTransforms]:
    reader = read_odometry if topic.msgtype == ODOMETRY else read_transforms
    return decode([packed], reader, cdr=cdr)


def _is_static(topic: Topic) -> bool:
    return topic.name.endswith(_STATIC_TOPIC)


def _assemble(
    recording: Recording,
    messages: RosMessages,
    scan_topic: Topic,
    odom_topic: Topic | None,
    config: SourceConfig,
) -> RecordedSource:
    blocks = messages.scans.get(scan_topic.name, [])
    if not blocks:
        raise BadInput(f"{scan_topic.name} holds no scans")
    table, moving = ScanTable(blocks), messages.moving
    odometry = messages.odometry.get(odom_topic.name) if odom_topic else None
    if config.segment is not None:
        count = len(segments(table.stamp_ns))
        moving = only_segment(moving, config.segment, count)
        odometry = only_segment(odometry, config.segment, count) if odometry else None
    tree, told = build_tree(moving, messages.fixed, config)
    laser = most_common_frame(blocks)
    robot, more = robot_frame(tree, odometry, laser, scan_topic.name, config)
    path, still_more = _odometry(tree, odometry, odom_topic, robot, config)
    told += [*more, *still_more, *tree.notices()]
    if path is not None and path.never_moves() and scans_change(blocks):
        told.append("the odometry never changes although scans do: not used")
        path = None
    return RecordedSource(
        table,
        path,
        mountings(tree, robot, scan_topic.name, config),
        config=config,
        topic=scan_topic.name,
        description=f"{recording.description}: {scan_topic.name} in {laser}, robot {robot}",
        notices=[*recording.notices, *messages.notices, *told],
    )


def _odometry(
    tree: TransformTree,
    odometry: StampedTransforms | None,
    topic: Topic | None,
    robot: str,
    config: SourceConfig,
) -> tuple[OdometryPath | None, list[str]]:
    if config.odom == "none":
        return None, []
    if odometry is not None and topic is not None and len(odometry):
        return odometry_of_topic(tree, odometry, topic.name, robot)
    return odometry_of_tree(tree, robot, config)
