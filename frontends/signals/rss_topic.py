# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of signal strength from a topic of a bag, by the message definitions in the bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief
from slarm_graph.frontends.recordings.ros_writing import typestore_of
from slarm_graph.radio.measured.rss_log import RssLog

_LISTS = (list, tuple, np.ndarray)
"""Types by which rosbags represents arrays."""


def read_rss_topic(
    recording: Sequence[Path],
    topic: str,
    value: str,
    names: Sequence[str],
    distro: str | None = None,
) -> RssLog:
    """Read a numeric field of a topic.

    Parameters
    ----------
    recording : sequence of Path
        ROS 1 bags, or a ROS 2 folder.
    topic : str
    value : str
        Field with the strength [dBm]; dots lead into submessages, also those of lists.
    names : sequence of str
        Fields that together name the access point, one or as many as levels; without any the
        topic does.
    distro : str, optional
        ROS 2 release whose message definitions to use where the bag has none.

    Raises
    ------
    BadInput
        When there is no such topic or field, or the field holds no numbers.
    """
    stamps: list[int] = []
    owners: list[str] = []
    values: list[float] = []
    try:
        with AnyReader(recorded(recording), default_typestore=typestore_of(distro)) as reader:
            connections = [c for c in reader.connections if c.topic == topic]
            if not connections:
                known = ", ".join(sorted({c.topic for c in reader.connections}))
                raise BadInput(f"--rss {topic}: no such topic; the recording has {known}")
            for connection, recorded_ns, raw in reader.messages(connections):
                message = _message(reader, raw, connection.msgtype)
                levels = [_number(one, value, topic) for one in _fields(message, value, topic)]
                values += levels
                owners += _owners(message, names, topic, len(levels))
                stamps += [_stamp_ns(message, recorded_ns)] * len(levels)
    except AnyReaderError as error:
        raise BadInput(f"--rss {topic}: the recording has no topics ({error})") from None
    described = f"{topic}, {count_of(len(values), 'reading')}"
    made = np.array(stamps, dtype=np.int64)
    return RssLog.of_rows(made, owners, np.array(values, dtype=np.float64), described)


def recorded(paths: Sequence[Path]) -> list[Path]:
    """Return the paths that rosbags opens: of a ROS 2 recording its folder."""
    return [path.parent if path.name == "metadata.yaml" else path for path in paths]


def _owners(message: object, names: Sequence[str], topic: str, count: int) -> list[str]:
    """Names of the access points of a message's levels.

    Raises
    ------
    BadInput
        When a list of names is of another length than that of levels.
    """
    told = [_fields(message, name, topic) for name in names]
    for name, words in zip(names, told, strict=True):
        if len(words) not in (1, count):
            raise BadInput(f"--rss {topic}: {len(words)} of {name} for {count} levels")
    of_all = [words * count if len(words) == 1 else words for words in told]
    if not of_all:
        return [topic.strip("/")] * count
    return [" ".join(map(str, one)) or topic.strip("/") for one in zip(*of_all, strict=True)]


def _fields(message: object, path: str, topic: str) -> list[object]:
    """Return the values of a dotted field path, of all elements of lists.

    Raises
    ------
    BadInput
        Where a part is missing, with those that are there.
    """
    values = [message]
    for name in path.split("."):
        for value in values:
            known = _parts(value)
            if name not in known:
                has = f"it has {', '.join(known)}" if known else "it has no parts"
                raise BadInput(f"--rss {topic}: no field {name!r} in {_kind(value)}; {has}")
        parts = [getattr(value, name) for value in values]
        values = [one for part in parts for one in (part if isinstance(part, _LISTS) else (part,))]
    return values


def _number(value: object, path: str, topic: str) -> float:
    if isinstance(value, (int, float, np.number)):
        return float(value)
    parts = _parts(value)
    advice = f", or a part of it: {', '.join(f'{path}.{name}' for name in parts)}" if parts else ""
    told = f"{path} is a {_kind(value)}, no number"
    raise BadInput(f"--rss {topic}: {told}; give a field with the level in dBm{advice}")


def _parts(value: object) -> list[str]:
    """Names of a message's fields; none where it is no message."""
    names = [one.name for one in fields(value)] if is_dataclass(value) else []
    return [name for name in names if not name.startswith("_")]


def _kind(value: object) -> str:
    """Return a message's ROS type; of other values the Python type."""
    return str(getattr(value, "__msgtype__", type(value).__name__))


def _message(reader: AnyReader, raw: bytes, msgtype: str) -> object:
    """Decode a message; a type of another release runs over its end, or into nonsense.

    Raises
    ------
    BadInput
        When the type that is taken for it does not fit.
    """
    try:
        return reader.deserialize(raw, msgtype)
    except AnyReaderError as error:
        raise BadInput(
            f"messages are of another release's {msgtype} ({brief(str(error))}); --ros-distro NAME"
            " says of which"
        ) from None


def _stamp_ns(message: object, recorded_ns: int) -> int:
    """The header's stamp, where there is one that was set [ns]."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec == 0 and stamp.nanosec == 0):
        return recorded_ns
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
