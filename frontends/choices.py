# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which topic holds the scans and which the odometry; where unclear, the flag that says so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from slarm_graph.errors import BadInput
from slarm_graph.frontends.messages import ODOMETRY, SCAN_TYPES
from slarm_graph.frontends.recordings import Topic


def choose_scan_topic(topics: Sequence[Topic], wanted: str | None) -> Topic:
    """Return the topic with the scans.

    Raises
    ------
    BadInput
        When there is none, or several and no choice; the message lists them with the flag.
    """
    scans = [topic for topic in topics if topic.msgtype in SCAN_TYPES]
    if wanted is not None:
        found = [topic for topic in scans if topic.name == "/" + wanted.lstrip("/")]
        if not found:
            raise BadInput(f"no scans on topic {wanted}; {_listed(scans or topics)}")
        return found[0]
    filled = [topic for topic in scans if topic.count] or scans
    if not filled:
        raise BadInput(f"no LaserScan topic in the recording; {_listed(topics)}")
    if len(filled) > 1:
        flags = " or ".join(f"--scan {topic.name}" for topic in filled)
        raise BadInput(f"{len(filled)} LaserScan topics; choose with {flags}; {_listed(filled)}")
    return filled[0]


def choose_odom_topic(topics: Sequence[Topic], wanted: str | None) -> Topic | None:
    """Return the topic with nav_msgs/Odometry, or None when tf or nothing has to do."""
    odoms = [topic for topic in topics if topic.msgtype == ODOMETRY and topic.count]
    if wanted in ("none", "tf"):
        return None
    if wanted is not None:
        found = [topic for topic in odoms if topic.name == "/" + wanted.lstrip("/")]
        if not found:
            raise BadInput(f"no odometry on topic {wanted}; {_listed(odoms or topics)}")
        return found[0]
    if len(odoms) > 1:
        usual = [topic for topic in odoms if topic.name == "/odom"]
        if not usual:
            flags = " or ".join(f"--odom {topic.name}" for topic in odoms)
            raise BadInput(f"{len(odoms)} Odometry topics; choose with {flags} or --odom none")
        return usual[0]
    return odoms[0] if odoms else None


def _listed(topics: Iterable[Topic]) -> str:
    told = ", ".join(
        f"{topic.name} ({topic.msgtype}, {topic.count} messages, {topic.rate_hz:.1f} Hz)"
        for topic in topics
    )
    return f"it has {told}" if told else "it has no topics"
