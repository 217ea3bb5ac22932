# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The robot's frame, the poses of its lasers, and its odometry, from tf and topics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.clock import segment_rows
from slarm_graph.frontends.recordings.messages import ScanBlock, StampedTransforms
from slarm_graph.frontends.recordings.mounting import Mounting, mounting_in_plane
from slarm_graph.frontends.recordings.odometry import (
    OdometryPath,
    path_from_messages,
    path_from_tree,
)
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.recorded_source import MountingAt
from slarm_graph.frontends.recordings.topic_choice import frame_like
from slarm_graph.frontends.recordings.transforms import TORN, TransformTree, parse_static, torn
from slarm_graph.geometry import compose

_ROBOT_FRAMES = ("base_footprint", "base_link", "base")
_ODOM_FRAMES = ("odom", "odom_combined", "odometry")
_MAX_MOUNTING_GAP_S = 1.0
"""Without `max_odom_gap_s`: longest gap over which the pose of a moving laser is interpolated."""

Told = list[str]


def build_tree(
    moving: StampedTransforms, fixed: StampedTransforms, config: SourceConfig
) -> tuple[TransformTree, Told]:
    """Build the tf tree, without transforms of another SLAM (map -> ...)."""
    told: Told = []
    extra = parse_static(config.static_tf)
    tree = TransformTree([moving], [fixed, extra] if extra else [fixed])
    if tree.refused:
        told.append(f"{tree.refused} transforms without a unit quaternion ignored")
    for parent, child in [pair for pair in tree.pairs() if pair[0] == "map"]:
        tree.remove((parent, child))
        told.append(f"tf {parent} -> {child} is another SLAM's output: ignored")
    return tree, told


def only_segment(part: StampedTransforms, wanted: int, count: int) -> StampedTransforms:
    """Keep what belongs to one of the scans' segments, every pair of frames by its own clock."""
    if len(part) == 0:
        return part
    kept = []
    for number in range(len(part.edges)):
        rows = np.flatnonzero(part.edge == number)
        kept.append(rows[segment_rows(part.stamp_ns[rows], wanted, count)])
    return part.subset(np.sort(np.concatenate(kept)))


def most_common_frame(blocks: Sequence[ScanBlock]) -> str:
    """Return the frame of most scans."""
    counts: Counter[str] = Counter()
    for block in blocks:
        counts[block.frame] += len(block)
    return str(counts.most_common(1)[0][0])


def robot_frame(
    tree: TransformTree,
    odometry: StampedTransforms | None,
    laser: str,
    scan_topic: str,
    config: SourceConfig,
) -> tuple[str, Told]:
    """Return the configured frame, else the odometry's child, else a usual name above the laser."""
    if config.robot_frame is not None:
        return config.robot_frame.lstrip("/"), []
    told: Told = []
    named, more = laser_in_tree(tree, laser, scan_topic, config)
    told += [] if laser else more
    laser = named
    if odometry is not None and len(odometry):
        child = odometry.edges[odometry.edge[0]][1]
        if child:
            robot, more = frame_in_tree(tree, child, scan_topic)
            return robot, told + more
        told.append("the odometry names no child frame: taken as the robot's")
    above = tree.ancestors(laser)
    for name in _ROBOT_FRAMES:
        for frame in above:
            if frame.rsplit("/", 1)[-1] == name:
                return frame, told
    if len(above) == 1:
        told.append(f"no tf for {laser}: the robot's frame is taken to be the laser's")
    else:
        told.append(f"no base_link in tf: the robot's frame is taken to be {above[-1]}")
    return above[-1], told


def frame_in_tree(tree: TransformTree, frame: str, scan_topic: str) -> tuple[str, Told]:
    """Return a frame's name in tf: the same, else one that differs by a prefix or namespace."""
    known = tree.frames()
    if frame in known or not known:
        return frame, []
    like = frame_like(frame, known, scan_topic)
    if like is None:
        return frame, []
    return like, [f"frame {frame} is taken to be {like} of tf"]


def laser_in_tree(
    tree: TransformTree, frame: str, scan_topic: str, config: SourceConfig
) -> tuple[str, Told]:
    """Return a laser's frame in tf; of scans that name none, the only possible one.

    That is the child of the one transform given, or the one frame of tf that has no others on it.

    Raises
    ------
    BadInput
        When several are possible.
    """
    if frame:
        return frame_in_tree(tree, frame, scan_topic)
    given = parse_static(config.static_tf)
    pairs = given.edges if given else tree.pairs()
    ends = sorted({child for _, child in pairs} - {parent for parent, _ in pairs})
    if not ends:
        return frame, []
    if len(ends) > 1:
        raise BadInput(
            f"the scans of {scan_topic} name no frame (frame_id is empty), and tf has several it"
            f" may be: {', '.join(ends[:6])}; give --static-tf 'PARENT laser x y z yaw' [m, rad]"
        )
    return ends[0], [f"the scans of {scan_topic} name no frame: taken to be {ends[0]} of tf"]


def mountings(tree: TransformTree, robot: str, scan_topic: str, config: SourceConfig) -> MountingAt:
    """Return the function that gives lasers' poses on the robot: fixed, or scan by scan."""

    def at(frame: str, stamps_ns: Ints) -> list[Mounting | None]:
        """Return the mounting of a laser at each stamp; None where tf has none."""
        frame, _ = laser_in_tree(tree, frame, scan_topic, config)
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


def odometry_of_topic(
    tree: TransformTree, messages: StampedTransforms, topic: str, robot: str
) -> tuple[OdometryPath, Told]:
    """Build the robot's path from an odometry topic, transformed to the robot's frame by tf."""
    told: Told = []
    zero = len(messages) > 0 and not messages.stamp_ns.any()
    if zero:
        told.append(f"all stamps in {topic} are 0: using the time of recording")
    if torn(messages.translations_m):
        raise BadInput(f"{topic} {TORN}; choose with --odom, or --odom none")
    path, useless = path_from_messages(messages, use_record_time=zero)
    bad = int(np.count_nonzero(useless))
    if bad and not len(path):
        raise BadInput(
            f"{topic}: no pose is valid (all are nowhere, or no unit quaternion); "
            "use --odom tf or none"
        )
    if bad:
        told.append(f"{bad} of {count_of(len(messages), 'pose')} in {topic} unusable, bridged")
    child = messages.edges[messages.edge[0]][1] if len(messages) else robot
    if len(path) and child != robot and tree.path(child, robot) is not None:
        turned, moved, _ = tree.lookup(child, robot, path.stamp_ns, np.iinfo(np.int64).max)
        headings = np.arctan2(turned[:, 1, 0], turned[:, 0, 0])
        child_from_robot = np.column_stack([moved[:, :2], headings])
        path = OdometryPath(path.stamp_ns, compose(path.poses, child_from_robot))
    return path, told


def odometry_of_tree(
    tree: TransformTree, robot: str, config: SourceConfig
) -> tuple[OdometryPath | None, Told]:
    """Build the robot's path from tf; None when nothing there moves."""
    usual = sorted(f for f in tree.frames() if f.rsplit("/", 1)[-1] in _ODOM_FRAMES)
    candidates = [config.odom_frame.lstrip("/")] if config.odom_frame else usual
    for odom in candidates:
        path = path_from_tree(tree, odom, robot)
        if len(path):
            return path, [f"odometry from tf {odom} -> {robot}"]
    odom = candidates[0] if candidates else "odom"
    return None, [
        f"no odometry found (no nav_msgs/Odometry, no tf {odom} -> {robot}): "
        "using scan matching only"
    ]


def scans_change(blocks: Sequence[ScanBlock]) -> bool:
    """Whether the scans show motion: a fifth of the beams differ by 0.2 m from the first scan's."""
    for block in blocks:
        if len(block) < 2 or block.ranges_m.shape[1] == 0:
            continue
        some = block.ranges_m[:: max(1, len(block) // 20)]
        with np.errstate(invalid="ignore"):
            moved = np.abs(some - some[:1]) > 0.2
        if moved.mean(axis=1).max() > 0.2:
            return True
    return False
