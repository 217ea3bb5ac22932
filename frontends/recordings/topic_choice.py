# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topics of scans, odometry and tf; errors name the option for ambiguous ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.messages import ODOMETRY, SCAN_TYPES
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
        raise BadInput(
            f"no LaserScan topic in the recording; it has {listed(topics)}{_way(topics)}"
        )
    if len(filled) > 1:
        flags = " or ".join(f"--scan {topic.name}" for topic in filled)
        told = listed(filled, frame_of)
        raise BadInput(f"{len(filled)} LaserScan topics; choose with {flags}; it has {told}")
    return filled[0]


def _way(topics: Sequence[Topic]) -> str:
    """Return advice where there are point clouds or depth images instead of scans."""
    for kind, tool in (
        ("sensor_msgs/msg/PointCloud2", "pointcloud_to_laserscan"),
        ("sensor_msgs/msg/Image", "depthimage_to_laserscan"),
    ):
        found = [topic.name for topic in topics if topic.msgtype == kind and topic.count]
        if found:
            return f". Only LaserScan is read: record a scan of {found[0]}, as {tool} makes it"
    return ""


def choose_odom_topic(
    topics: Sequence[Topic], wanted: str | None, scan: Topic, scans: Sequence[Topic]
) -> tuple[Topic | None, list[str]]:
    """Return the topic with nav_msgs/Odometry, and notices on the choice.

    The topic is None where tf or nothing is used instead. Of several the one in the scans'
    namespace is taken, else /odom; topics of another robot's scans are not considered.

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
    """Format topics with type, frame, count and rate."""
    return (
        ", ".join(
            f"{topic.name} ({topic.msgtype}{f' in {frame_of(topic)}' if frame_of else ''}, "
            f"{count_of(topic.count, 'message')}, {topic.rate_hz:.1f} Hz)"
            for topic in topics
        )
        or "no topics"
    )


def namespace(name: str) -> str:
    """Return the namespace of a topic: `/robot1` of `/robot1/scan`, empty of `/scan`."""
    return name.rpartition("/")[0]


def within(space: str, other: str) -> bool:
    """Whether a namespace equals another one or lies in it."""
    return other == "" or space == other or space.startswith(f"{other}/")


def own(topics: Sequence[Topic], scan: Topic, scans: Sequence[Topic]) -> list[Topic]:
    """Drop the topics that belong to the robot of another scan topic.

    A topic does when its namespace holds another scan topic but not the chosen one. Lasers of one
    robot often have namespaces of their own, hence a namespace alone tells nothing.
    """
    others = [namespace(topic.name) for topic in scans if topic.name != scan.name]
    here = namespace(scan.name)
    return [
        topic
        for topic in topics
        if within(here, namespace(topic.name))
        or not any(within(other, namespace(topic.name)) for other in others)
    ]


def choose_tf_topics(
    topics: Sequence[Topic], scan: Topic, scans: Sequence[Topic], wanted: str | None
) -> tuple[list[Topic], list[str]]:
    """Return the tf topics of the robot whose scans are used, and notices on the choice.

    Raises
    ------
    BadInput
        When tf comes from several namespaces and none of them is the robot's, or the wanted one
        has none.
    """
    spaces = {namespace(topic.name) for topic in topics}
    if wanted is not None:
        space = f"/{wanted.strip('/')}" if wanted.strip("/") else ""
        if space not in spaces:
            raise BadInput(f"no tf in namespace {wanted}; it comes from {_names(topics)}")
        return [topic for topic in topics if namespace(topic.name) == space], []
    if len(spaces) < 2:
        return list(topics), []
    here = namespace(scan.name)
    fitting = [space for space in spaces if within(here, space)]
    if not fitting:
        mine = own(topics, scan, scans)
        if len({namespace(topic.name) for topic in mine}) == 1:
            return mine, []
        raise BadInput(
            f"tf comes from {_names(topics)}, none of them beside {scan.name}; choose with "
            "--set source.tf_namespace=..."
        )
    best = max(fitting, key=len)
    chosen = [topic for topic in topics if namespace(topic.name) in (best, "")]
    left = [topic for topic in topics if topic not in chosen]
    told = [f"using tf of {best or '/'}, not {_names(left)}"] if left else []
    return chosen, told


def _names(topics: Sequence[Topic]) -> str:
    return ", ".join(sorted(topic.name for topic in topics))


def frame_like(frame: str, known: set[str], scan_topic: str) -> str | None:
    """Find the one known frame that differs from a name by a prefix or namespace only.

    `robot1/laser` and `robot1_laser` are both like `laser`; of several, the one in the namespace
    of the scan topic counts.
    """
    last = frame.rpartition("/")[2]
    for joint in ("/", "_"):
        like = [
            other
            for other in sorted(known)
            if other.rpartition("/")[2] == last
            or other.endswith(f"{joint}{last}")
            or last.endswith(f"{joint}{other}")
        ]
        mine = [other for other in like if within(f"/{other}", namespace(scan_topic))]
        for some in (like, mine):
            if len(some) == 1:
                return some[0]
    return None
