# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Detection of topics with signal strength, by the names of their fields and by their values.

ROS has no message for signal strength; custom ones usually call it rssi, rss or dbm. A topic that
matches by name and by its values is used; a possible one is only reported.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief
from slarm_graph.frontends.recordings.recordings import Topic
from slarm_graph.frontends.recordings.ros_writing import typestore_of
from slarm_graph.frontends.recordings.rosbag import open_recording
from slarm_graph.frontends.signals.rss_topic import read_rss_topic, recorded
from slarm_graph.radio.measured.rss_log import RssLog

_STANDARD: Final = {
    "actionlib_msgs", "action_msgs", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs",
    "map_msgs", "nav_msgs", "rcl_interfaces", "rosgraph_msgs", "sensor_msgs", "shape_msgs",
    "stereo_msgs", "tf", "tf2_msgs", "trajectory_msgs", "visualization_msgs",
}  # fmt: skip
"""Packages whose messages have no signal strength (common_interfaces, rcl_interfaces, tf): most
bags hold nothing else, and are not opened a second time."""
_STRENGTH: Final = {"rss", "rssi"}
"""Words that mean received signal strength and nothing else."""
_BESIDE: Final = {
    "ant", "antenna", "ble", "bluetooth", "dbm", "last", "level", "raw", "signal", "strength",
    "uwb", "value", "wifi", "wireless", "wlan",
}  # fmt: skip
"""Words allowed beside these; others change the meaning (rssi_threshold, rssi_sd)."""
_NAMES: Final = (
    {"bssid", "mac", "address", "uuid"},
    {"ap", "access", "anchor", "beacon", "tag", "station", "ssid", "essid"},
    {"id", "name", "device", "node", "major", "minor"},
)
"""Words in names of fields that identify the access point, the most reliable kind first."""
_COUNTERS: Final = {"seq", "msg", "message", "packet", "frame", "scan", "sample"}
"""Words beside which `id` is a message number."""
_LEAST_DBM, _MOST_DBM = -140.0, 0.0
"""Received power (3GPP TS 36.133, 9.1.4: RSRP from -140 dBm; radios by design below 0 dBm);
shares of 100 % and decibels above noise are positive."""
_LEAST_PER_NAME: Final = 3.0
"""Least mean number of readings per access point; with fewer the name identifies messages."""
_NUMBERS: Final = re.compile(r"u?int\d+|float\d+")


@dataclass(frozen=True, slots=True)
class FoundRss:
    """A topic with certain or possible signal strength.

    Parameters
    ----------
    topic, option : str
        Value of `--rss` that reads it; empty where none does.
    log : RssLog or None
        Its readings, where they certainly are signal strength.
    what : str
        Why it is not certain; empty where it is.
    """

    topic: str
    option: str
    log: RssLog | None = None
    what: str = ""

    def what_it_is(self) -> str:
        """Describe the content of the topic."""
        if self.log is None:
            return f"may hold signal strength, which is not used: {self.what}"
        names = count_of(len(self.log.names), "access point")
        return f"holds signal strength: {count_of(len(self.log), 'reading')}, {names}"

    def advice(self) -> str:
        """Return how to use it, or how to ignore it."""
        if self.log is not None:
            return f"used as --rss {self.option}; --rss none leaves it out"
        return f"--rss {self.option} uses it" if self.option else ""

    def notice(self) -> str:
        """Return both as one line."""
        told = f"{self.topic} {self.what_it_is()}"
        return f"{told}; {self.advice()}" if self.advice() else told


def found_rss(paths: Sequence[Path], distro: str | None = None) -> tuple[FoundRss, ...]:
    """Find topics with possible signal strength; empty where the recording is no bag, or missing.

    Parameters
    ----------
    paths : sequence of Path
    distro : str, optional
        ROS 2 release whose message definitions to use where the bag has none.
    """
    try:
        topics = [topic for topic in open_recording(paths).topics if _may_hold(topic)]
    except (BadInput, OSError):
        return ()
    if not topics:
        return ()
    try:
        with AnyReader(recorded(paths), default_typestore=typestore_of(distro)) as reader:
            fields = {topic: tuple(_fields(reader.typestore, topic.msgtype)) for topic in topics}
        return tuple(
            found for topic in topics for found in _found(paths, topic, fields[topic], distro)
        )
    except Exception as error:  # rosbags has no common one, and nobody asked for these topics
        what = f"it cannot be read ({brief(str(error))})"
        return tuple(FoundRss(t.name, "", what=what) for t in topics if _is_strength(_last(t.name)))


def _may_hold(topic: Topic) -> bool:
    package = topic.msgtype.partition("/")[0]
    is_bare = package == "std_msgs" and not _is_strength(_last(topic.name))
    return topic.count > 0 and package not in _STANDARD and not is_bare


def _last(name: str) -> str:
    return name.rpartition("/")[2]


def _words(name: str) -> list[str]:
    """Words of a name in snake or camel case."""
    parts = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().split("_")
    return [part for part in parts if part]


def _is_strength(name: str) -> bool:
    words = set(_words(name))
    is_level = "dbm" in words and words & {"signal", "level", "strength"}
    return bool(words & _STRENGTH or is_level) and words <= _STRENGTH | _BESIDE


def _fields(types: Typestore, msgtype: str, above: str = "") -> Iterator[tuple[str, str]]:
    """Yield path and base type of everything in a message, also in what its lists hold."""
    for name, node in types.fielddefs.get(msgtype, ((), ()))[1]:
        part = node[1][0] if node[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else node
        if part[0] == Nodetype.NAME:
            yield from _fields(types, str(part[1]), f"{above}{name}.")
        else:
            yield f"{above}{name}", str(part[1][0])


def _found(
    paths: Sequence[Path], topic: Topic, fields: Sequence[tuple[str, str]], distro: str | None
) -> Iterator[FoundRss]:
    """Examine one topic: its fields, then its readings."""
    if not fields and _is_strength(_last(topic.name)):
        yield FoundRss(topic.name, "", what=f"the bag has no definition of {topic.msgtype}")
    numbers = [path for path, kind in fields if _NUMBERS.fullmatch(kind)]
    values = [path for path in numbers if _is_strength(path.rpartition(".")[2])]
    if not values and _is_strength(_last(topic.name)):
        values = [path for path in numbers if path == "data"]
    for value in values:
        names = _naming(value, fields)
        option = f"{topic.name}:{','.join((value, *names))}"
        try:
            log = read_rss_topic(paths, topic.name, value, names, distro)
        except BadInput as error:
            yield FoundRss(topic.name, "", what=str(error))
            continue
        what = f"one of {', '.join(values)}" if len(values) > 1 else _what_is_odd(log)
        yield FoundRss(topic.name, option, None if what else log, what)


def _naming(value: str, fields: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return the fields, beside a strength or around it, that identify the access point."""
    above = value.rpartition(".")[0]
    for space in dict.fromkeys((f"{above}." if above else "", "")):
        beside = [path[len(space) :] for path, _ in fields if path.startswith(space)]
        own = [name for name in beside if "." not in name and not set(_words(name)) & _COUNTERS]
        for kind in _NAMES:
            chosen = [f"{space}{name}" for name in own if set(_words(name)) & kind]
            if chosen:
                return tuple(chosen)
    return ()


def _what_is_odd(log: RssLog) -> str:
    """Return why the readings do not look like signal strength in dBm; else empty."""
    heard = log.rss_dbm[np.isfinite(log.rss_dbm)]
    if not len(heard):
        return "no reading has a value"
    low, high = float(heard.min()), float(heard.max())
    if low < _LEAST_DBM or high >= _MOST_DBM:
        return f"values from {low:g} to {high:g} are no dBm"
    if len(log) < _LEAST_PER_NAME * len(log.names):
        return f"{len(log)} readings have {len(log.names)} names"
    return ""
