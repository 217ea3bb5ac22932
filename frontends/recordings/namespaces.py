# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Several robots in one recording: whose tf and odometry belong to the chosen scans."""

from __future__ import annotations

from collections.abc import Sequence

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.recordings import Topic


def namespace(name: str) -> str:
    """Return what stands before the last slash: `/robot1` of `/robot1/scan`, nothing of `/scan`."""
    return name.rpartition("/")[0]


def within(space: str, other: str) -> bool:
    """Whether a namespace is another one or lies in it."""
    return other == "" or space == other or space.startswith(f"{other}/")


def own(topics: Sequence[Topic], scan: Topic, scans: Sequence[Topic]) -> list[Topic]:
    """Leave out the topics that belong to the robot of another scan topic.

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
    """Return the tf topics of the robot whose scans are used, and what to tell of the choice.

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
            raise BadInput(f"no tf in namespace {wanted}; it comes from {_listed(topics)}")
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
            f"tf comes from {_listed(topics)}, none of them beside {scan.name}; choose with "
            "--set source.tf_namespace=..."
        )
    best = max(fitting, key=len)
    chosen = [topic for topic in topics if namespace(topic.name) in (best, "")]
    left = [topic for topic in topics if topic not in chosen]
    told = [f"using tf of {best or '/'}, not {_listed(left)}"] if left else []
    return chosen, told


def _listed(topics: Sequence[Topic]) -> str:
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
