# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of signal strength: CSV with `stamp, ap, rss_dbm`, and logs of Bluetooth anchors.

Anchors hear a tag on the robot (Kolakowski, Sensors 21:6270). A line of theirs has tab-separated
columns: time [ms], the anchor's slot, two counters, the anchor's identifier, how many Bluetooth and
how many UWB packets follow; then for every Bluetooth packet antenna, kind, time, strength [dBm],
the tag's identifier, two counters and a zero.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.files.trajectory_columns import stamp_ns
from slarm_graph.radio.measured.rss_log import RssLog

_STAMPS = {"stamp_ns": "ns", "stamp": "", "stamp_s": "", "time": "", "timestamp": ""}
"""Names of the stamp column, with the unit that a name implies; else the size of stamps decides."""
_NAMES = ("ap", "access_point", "bssid", "ssid", "name")
_VALUES = ("rss_dbm", "rssi_dbm", "rssi", "rss")
_HEAD, _PER_PACKET, _STRENGTH = 7, 8, 3
"""Columns before the packets, of each packet, and which of these is the strength."""

_PERIOD_NS = 1_000_000_000
"""Every anchor reports once a second; a packet lies somewhere within, taken in the middle."""


def looks_like_anchor_log(path: Path) -> bool:
    """Whether the first line is one of such a log."""
    try:
        with path.open(encoding="utf-8") as file:
            words = file.readline().split("\t")
        return len(words) >= _HEAD and all(word.strip().isdigit() for word in words[:_HEAD])
    except (OSError, UnicodeDecodeError):
        return False


def read_anchor_log(path: Path) -> RssLog:
    """Read a log; an anchor that heard no packet in its second did not hear the tag.

    The packets of one anchor and second are averaged.

    Raises
    ------
    BadInput
        Naming the line that cannot be read.
    """
    stamps, names, values = [], [], []
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, start=1):
            words = line.split()
            try:
                packets = int(words[5])
                strengths = [
                    float(words[_HEAD + _PER_PACKET * k + _STRENGTH]) for k in range(packets)
                ]
                stamps.append(int(words[0]) * 1_000_000 - _PERIOD_NS // 2)
                names.append(words[4])
            except (ValueError, IndexError) as error:
                raise BadInput(f"{path}:{number}: not a line of anchors ({error})") from None
            values.append(float(np.mean(strengths)) if strengths else np.nan)
    made = np.array(stamps, dtype=np.int64)
    return RssLog.of_rows(
        made, names, np.array(values), f"{path.name}, {count_of(len(stamps), 'report')}"
    )


def read_rss_csv(path: Path) -> RssLog:
    """Read a CSV file with a header.

    Raises
    ------
    BadInput
        Naming the missing column, or the line that cannot be read.
    """
    stamps: list[int] = []
    names: list[str] = []
    values: list[float] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            header = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = header
            stamp = _column(path, header, tuple(_STAMPS))
            name, value = _column(path, header, _NAMES), _column(path, header, _VALUES)
            for row in reader:
                told = [row[column] for column in (stamp, name, value)]
                if None in told:
                    raise ValueError("fewer values than columns")
                stamps.append(stamp_ns(told[0].strip(), _STAMPS[stamp]))
                names.append(told[1].strip())
                values.append(float(told[2] or "nan"))
    except (ValueError, TypeError, UnicodeDecodeError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}:{len(values) + 2}: not a reading ({error})") from None
    if not stamps:
        raise BadInput(f"{path} has no reading")
    made = np.array(stamps, dtype=np.int64)
    return RssLog.of_rows(
        made, names, np.array(values), f"{path.name}, {count_of(len(stamps), 'reading')}"
    )


def _column(path: Path, header: list[str], wanted: tuple[str, ...]) -> str:
    for name in wanted:
        if name in header:
            return name
    raise BadInput(
        f"{path} has the columns {', '.join(header) or 'of nothing'}; it needs {wanted[0]}"
        " (stamp, ap, rss_dbm)"
    )
