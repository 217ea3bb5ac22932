# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of signal strength from CSV: `stamp, ap, rss_dbm`; an empty value: not heard."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from slarm_graph.errors import BadInput
from slarm_graph.radio.measured.log import RssLog

_STAMPS = {"stamp_ns": 1.0, "stamp": 1e9, "stamp_s": 1e9, "time": 1e9, "timestamp": 1e9}
"""Names of the column of stamps, and the nanoseconds of its unit: seconds unless a name says so."""
_NAMES = ("ap", "access_point", "bssid", "ssid", "name")
_VALUES = ("rss_dbm", "rssi_dbm", "rssi", "rss")

NANOSECONDS_FROM = 1e14
"""A stamp above this is in nanoseconds: as seconds it would be three million years off."""


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
                stamps.append(_nanoseconds(row[stamp], _STAMPS[stamp]))
                names.append(str(row[name]).strip())
                values.append(float(row[value] or "nan"))
    except (ValueError, TypeError, UnicodeDecodeError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}:{len(values) + 2}: not a reading ({error})") from None
    if not stamps:
        raise BadInput(f"{path} has no reading")
    made = np.array(stamps, dtype=np.int64)
    return RssLog.of_rows(made, names, np.array(values), f"{path.name}, {len(stamps)} readings")


def _column(path: Path, header: list[str], wanted: tuple[str, ...]) -> str:
    for name in wanted:
        if name in header:
            return name
    raise BadInput(
        f"{path} has the columns {', '.join(header) or 'of nothing'}; it needs {wanted[0]}"
        " (stamp, ap, rss_dbm)"
    )


def _nanoseconds(text: str, scale: float) -> int:
    """Nanoseconds of a stamp, without the rounding of a float where it is whole."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"stamp {text}")
    if abs(number) >= NANOSECONDS_FROM or scale == 1.0:
        return int(text) if text.strip().lstrip("-").isdigit() else int(number)
    whole, _, part = text.strip().partition(".")
    if whole.lstrip("-").isdigit() and (part.isdigit() or not part):
        return int(whole) * 10**9 + int((part + "0" * 9)[:9])
    return round(number * scale)
