# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounded reading of text files, with one-line errors; CSV text."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from slarm_graph.errors import BadInput, brief

MAX_TEXT_BYTES = 1 << 28
"""256 MB: a TUM line has about 100 bytes, so this is the trajectory of three days at 10 Hz. Text
becomes about ten times as large as Python objects."""


def read_text(path: Path, what: str = "text", at_most: int = MAX_TEXT_BYTES) -> str:
    """Read a UTF-8 file, with or without byte order mark.

    Parameters
    ----------
    path : Path
    what : str
        Expected content, for messages, as in `cannot be read as WHAT`.
    at_most : int
        Largest size [bytes].

    Raises
    ------
    BadInput
        When it is missing, is no such text, or is larger.
    """
    try:
        if path.is_file() and path.stat().st_size > at_most:
            size_mb = path.stat().st_size / 1e6
            raise BadInput(
                f"{path}: {size_mb:.1f} MB are too large for {what} (at most {at_most / 1e6:.1f})"
            )
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except OSError as error:
        raise BadInput(f"{path}: cannot be read as {what} ({error.strerror})") from None
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        problem = f"byte 0x{byte:02x} at {error.start} is not of a UTF-8 text"
        raise BadInput(f"{path}: cannot be read as {what} ({problem})") from None
    except ValueError as error:  # a name with a null byte in it
        raise BadInput(f"{brief(str(path))}: cannot be read as {what} ({error})") from None


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return columns and rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


def csv_of(records: Sequence[Mapping[str, object]]) -> str:
    """Return at least one record as CSV; all have the keys of the first."""
    return csv_text(tuple(records[0]), (tuple(record.values()) for record in records))
