# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of signal strength from a topic of a bag, by the definitions that the bag brings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief
from slarm_graph.frontends.recordings.ros_writing import typestore_of
from slarm_graph.radio.measured.log import RssLog


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
        Field with the strength [dBm]; dots lead into parts.
    names : sequence of str
        Fields that together name the access point; without any the topic does.
    distro : str, optional
        ROS 2 release whose types hold where the bag brings no definitions.

    Raises
    ------
    BadInput
        When there is no such topic or field, or the field holds no numbers.
    """
    folders = [p.parent if p.name == "metadata.yaml" else p for p in recording]
    stamps, owners, values = [], [], []
    try:
        with AnyReader(folders, default_typestore=typestore_of(distro)) as reader:
            connections = [c for c in reader.connections if c.topic == topic]
            if not connections:
                known = ", ".join(sorted({c.topic for c in reader.connections}))
                raise BadInput(f"--rss {topic}: no such topic; the recording has {known}")
            for connection, recorded_ns, raw in reader.messages(connections):
                message = _message(reader, raw, connection.msgtype)
                values.append(_number(_field(message, value, topic), value, topic))
                words = [str(_field(message, name, topic)) for name in names]
                owners.append(" ".join(words) or topic.strip("/"))
                stamps.append(_stamp_ns(message, recorded_ns))
    except AnyReaderError as error:
        raise BadInput(f"--rss {topic}: the recording has no topics ({error})") from None
    described = f"{topic}, {count_of(len(values), 'reading')}"
    made = np.array(stamps, dtype=np.int64)
    return RssLog.of_rows(made, owners, np.array(values), described)


def _field(message: object, path: str, topic: str) -> object:
    """Follow dots into a message.

    Raises
    ------
    BadInput
        Where a part is missing, with those that are there.
    """
    value = message
    for name in path.split("."):
        known = _parts(value)
        if name not in known:
            has = f"it has {', '.join(known)}" if known else "it has no parts"
            raise BadInput(f"--rss {topic}: no field {name!r} in {_kind(value)}; {has}")
        value = getattr(value, name)
    return value


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
    """A message's type as ROS writes it; of other values Python's."""
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
