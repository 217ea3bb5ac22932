# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which topic holds the scans and which the odometry; where unclear, the flag that says so."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.messages import ODOMETRY, SCAN_TYPES
from slarm_graph.frontends.recordings.namespaces import namespace, own
from slarm_graph.frontends.recordings.recordings import Topic

FrameOf = Callable[[Topic], str]
"""Finds the frame of a topic's first message."""


def choose_scan_topic(topics: Sequence[Topic], wanted: str | None, frame_of: FrameOf) -> Topic:
    """Return the topic with the scans.

    Raises
    ------
    BadInput
        When there is none, or several and no choice; the message lists them with the flag.
    """
    scans = [topic for topic in topics if topic.msgtype in SCAN_TYPES]
    if wanted is not None:
        found = [topic for topic in scans if topic.name == _absolute(wanted)]
        if not found:
            raise BadInput(f"no scans on topic {wanted}; it has {listed(scans or topics)}")
        return found[0]
    filled = [topic for topic in scans if topic.count] or scans
    if not filled:
        raise BadInput(f"no LaserScan topic in the recording; it has {listed(topics)}")
    if len(filled) > 1:
        flags = " or ".join(f"--scan {topic.name}" for topic in filled)
        told = listed(filled, frame_of)
        raise BadInput(f"{len(filled)} LaserScan topics; choose with {flags}; it has {told}")
    return filled[0]


def choose_odom_topic(
    topics: Sequence[Topic], wanted: str | None, scan: Topic, scans: Sequence[Topic]
) -> tuple[Topic | None, list[str]]:
    """Return the topic with nav_msgs/Odometry, and what to tell of the choice.

    The topic is None where tf or nothing has to do. Of several the one beside the scans is taken,
    else /odom; what belongs to another robot's scans is not considered.

    Raises
    ------
    BadInput
        When the wanted one is not there, or several are and none is called /odom.
    """
    odoms = [topic for topic in topics if topic.msgtype == ODOMETRY and topic.count]
    if wanted in ("none", "tf"):
        return None, []
    if wanted is not None:
        found = [topic for topic in odoms if topic.name == _absolute(wanted)]
        if not found:
            raise BadInput(f"no odometry on topic {wanted}; it has {listed(odoms or topics)}")
        return found[0], []
    mine = own(odoms, scan, scans)
    if odoms and not mine:
        return None, [f"{listed(odoms)} is another robot's: not used; --odom takes it"]
    odoms = mine
    if len(odoms) < 2:
        return (odoms[0] if odoms else None), []
    beside = [t for t in odoms if namespace(t.name) == namespace(scan.name) != ""]
    usual = next((topic for topic in odoms if topic.name == "/odom"), None)
    usual = beside[0] if len(beside) == 1 else usual
    if usual is None:
        flags = " or ".join(f"--odom {topic.name}" for topic in odoms)
        raise BadInput(f"{len(odoms)} Odometry topics; choose with {flags} or --odom none")
    others = ", ".join(topic.name for topic in odoms if topic is not usual)
    return usual, [f"using {usual.name}, not {others}; choose with --odom"]


def _absolute(name: str) -> str:
    return "/" + name.lstrip("/")


def listed(topics: Iterable[Topic], frame_of: FrameOf | None = None) -> str:
    """Write topics with type, frame, count and rate."""
    return (
        ", ".join(
            f"{topic.name} ({topic.msgtype}{f' in {frame_of(topic)}' if frame_of else ''}, "
            f"{topic.count} messages, {topic.rate_hz:.1f} Hz)"
            for topic in topics
        )
        or "no topics"
    )
