# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Choose topics and frames of a ROS recording and make readings of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.choices import choose_odom_topic, choose_scan_topic
from slarm_graph.frontends.messages import (
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
from slarm_graph.frontends.mounting import Mounting, mounting_in_plane
from slarm_graph.frontends.odometry import OdometryPath, path_from_messages, path_from_tree
from slarm_graph.frontends.packed import Cursor, Ints, Malformed, Packed
from slarm_graph.frontends.readings_from import MountingAt, RecordedSource
from slarm_graph.frontends.recordings import Recording, Topic
from slarm_graph.frontends.rosbag import open_recording
from slarm_graph.frontends.scan_table import ScanTable
from slarm_graph.frontends.transforms import TransformTree, parse_static

_ROBOT_FRAMES = ("base_footprint", "base_link", "base")
_STATIC_TOPIC = "/tf_static"
_MAX_MOUNTING_GAP_S = 1.0


@dataclass(slots=True)
class RosMessages:
    """The decoded topics of a recording.

    Parameters
    ----------
    scans : dict of topic name to list of ScanBlock
    odometry : dict of topic name to StampedTransforms
    moving, fixed : StampedTransforms
        From /tf and /tf_static.
    """

    scans: dict[str, list[ScanBlock]]
    odometry: dict[str, StampedTransforms]
    moving: StampedTransforms
    fixed: StampedTransforms


def open_ros(paths: Sequence[Path], config: SourceConfig) -> RecordedSource:
    """Open ROS recordings as one source of readings."""
    recording = open_recording(paths)
    scan_topic = choose_scan_topic(
        recording.topics, config.scan_topic, partial(first_frame, recording)
    )
    odom_topic, told = choose_odom_topic(recording.topics, config.odom)
    tf_topics = [topic for topic in recording.topics if topic.msgtype in TF_TYPES]
    wanted = [scan_topic, *tf_topics, *([odom_topic] if odom_topic else [])]
    messages = read_messages(recording, wanted, echo=config.echo)
    return _assemble(recording, messages, scan_topic, odom_topic, config, told)


def first_frame(recording: Recording, topic: Topic) -> str:
    """Return the frame of a scan topic's first message, `?` where it cannot be read."""
    for _, packed in recording.read([topic]):
        first = packed.subset(np.arange(min(1, len(packed))))
        try:
            blocks = _decode_scans(first, topic, recording.cdr, "first", 0)
        except Malformed:
            break
        return blocks[0].frame if blocks else "?"
    return "?"


def read_messages(
    recording: Recording, topics: Sequence[Topic], *, echo: str = "first"
) -> RosMessages:
    """Decode some topics of a recording in one pass over it."""
    scans: dict[str, list[ScanBlock]] = {}
    transforms: dict[Topic, list[StampedTransforms]] = {topic: [] for topic in topics}
    seen = dict.fromkeys(topics, 0)
    for topic, packed in recording.read(topics):
        try:
            if topic.msgtype in SCAN_TYPES:
                blocks = scans.setdefault(topic.name, [])
                blocks += _decode_scans(packed, topic, recording.cdr, echo, seen[topic])
            else:
                reader = read_odometry if topic.msgtype == ODOMETRY else read_transforms
                transforms[topic] += decode([packed], reader, cdr=recording.cdr)
        except Malformed as error:
            raise BadInput(f"{recording.description}: {topic.name}: {error}") from None
        seen[topic] += len(packed)
    odometry = {
        topic.name: join_transforms(parts)
        for topic, parts in transforms.items()
        if topic.msgtype == ODOMETRY
    }
    tf = {topic: parts for topic, parts in transforms.items() if topic.msgtype in TF_TYPES}
    return RosMessages(
        scans,
        odometry,
        join_transforms([p for t, parts in tf.items() if not _is_static(t) for p in parts]),
        join_transforms([p for t, parts in tf.items() if _is_static(t) for p in parts]),
    )


def _is_static(topic: Topic) -> bool:
    return topic.name.endswith(_STATIC_TOPIC)


def _decode_scans(
    packed: Packed, topic: Topic, cdr: bool, echo: str, offset: int
) -> list[ScanBlock]:
    def one(cursor: Cursor) -> list[ScanBlock]:
        return read_multi_echo(cursor, echo) if topic.msgtype == MULTI_ECHO else read_scans(cursor)

    blocks = [block for part in decode([packed], one, cdr=cdr) for block in part]
    return [replace(block, index=block.index + offset) for block in blocks]


def _assemble(
    recording: Recording,
    messages: RosMessages,
    scan_topic: Topic,
    odom_topic: Topic | None,
    config: SourceConfig,
    told: Sequence[str],
) -> RecordedSource:
    blocks = messages.scans.get(scan_topic.name, [])
    if not blocks:
        raise BadInput(f"{scan_topic.name} holds no scans")
    notices = [*recording.notices, *told]
    tree = _tree(messages, config, notices)
    odometry = messages.odometry.get(odom_topic.name) if odom_topic else None
    robot = _robot_frame(tree, odometry, blocks, config, notices)
    path = _odometry_path(tree, odometry, odom_topic, robot, blocks, config, notices)
    return RecordedSource(
        ScanTable(blocks),
        path,
        mountings(tree, robot, config),
        config=config,
        topic=scan_topic.name,
        description=f"{recording.description}: {scan_topic.name}",
        notices=notices,
    )


def _tree(messages: RosMessages, config: SourceConfig, notices: list[str]) -> TransformTree:
    extra = parse_static(config.static_tf)
    fixed = [messages.fixed, extra] if extra else [messages.fixed]
    tree = TransformTree([messages.moving], fixed)
    if tree.refused:
        notices.append(f"{tree.refused} transforms without a unit quaternion ignored")
    for parent, child in [pair for pair in tree.edges if pair[0] == "map"]:
        del tree.edges[parent, child]
        notices.append(f"tf {parent} -> {child} is another SLAM's output: ignored")
    return tree


def _robot_frame(
    tree: TransformTree,
    odometry: StampedTransforms | None,
    blocks: list[ScanBlock],
    config: SourceConfig,
    notices: list[str],
) -> str:
    """The configured frame, else the odometry's child, else the usual names above the laser."""
    laser = _usual_frame(blocks)
    if config.robot_frame is not None:
        return config.robot_frame.lstrip("/")
    if odometry is not None and len(odometry):
        child = odometry.edges[0][1]
        if child:
            return child
        notices.append("the odometry names no child frame: taken as the robot's")
    for frame in _ROBOT_FRAMES:
        if frame == laser or tree.path(frame, laser) is not None:
            return frame
    if not tree.edges or laser not in tree.frames():
        notices.append(f"no tf for {laser}: the robot's frame is taken to be the laser's")
        return laser
    root = tree.root(laser)
    notices.append(f"no base_link in tf: the robot's frame is taken to be {root}")
    return root


def _usual_frame(blocks: Sequence[ScanBlock]) -> str:
    """The frame most scans are in."""
    counts: Counter[str] = Counter()
    for block in blocks:
        counts[block.frame] += len(block)
    return counts.most_common(1)[0][0]


def mountings(tree: TransformTree, robot: str, config: SourceConfig) -> MountingAt:
    """Find where lasers sit on the robot: once when fixed, else scan by scan."""

    def at(frame: str, stamps_ns: Ints) -> list[Mounting | None]:
        if frame == robot:
            return [Mounting()] * len(stamps_ns)
        moving = bool(tree.changing(robot, frame))
        when = stamps_ns if moving else stamps_ns[:1]
        gap_ns = round((config.max_odom_gap_s or _MAX_MOUNTING_GAP_S) * 1e9)
        turned, moved, known = tree.lookup(robot, frame, when, gap_ns)
        found = [
            mounting_in_plane(turned[row], moved[row], frame) if known[row] else None
            for row in range(len(when))
        ]
        return found if moving else found * len(stamps_ns)

    return at


def _odometry_path(
    tree: TransformTree,
    odometry: StampedTransforms | None,
    topic: Topic | None,
    robot: str,
    blocks: list[ScanBlock],
    config: SourceConfig,
    notices: list[str],
) -> OdometryPath | None:
    if config.odom == "none":
        return None
    if odometry is not None and topic is not None:
        zero = len(odometry) > 0 and not odometry.stamp_ns.any()
        path, bad = path_from_messages(odometry, use_record_time=zero)
        if bad and not len(path):
            raise BadInput(
                f"{topic.name}: all {bad} poses lack a unit quaternion; use --odom tf or none"
            )
        if bad:
            notices.append(f"{bad} of {len(odometry)} poses in {topic.name} unusable, skipped")
    else:
        odom = config.odom_frame or "odom"
        path = path_from_tree(tree, odom, robot)
        if not len(path):
            notices.append(
                "no odometry found (no nav_msgs/Odometry, no tf odom -> "
                f"{robot}): using scan matching only"
            )
            return None
        notices.append(f"odometry from tf {odom} -> {robot}")
    if path.never_moves() and scans_change(blocks):
        notices.append("the odometry never changes although scans do: not used")
        return None
    return path


def scans_change(blocks: Sequence[ScanBlock]) -> bool:
    """Whether the scans show motion: a fifth of the beams differ by 0.2 m from the first scan's."""
    for block in blocks:
        if len(block) < 2:
            continue
        some = block.ranges_m[:: max(1, len(block) // 20)]
        with np.errstate(invalid="ignore"):
            moved = np.abs(some - some[:1]) > 0.2
        if moved.mean(axis=1).max() > 0.2:
            return True
    return False
