# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How many there are of something, in words."""

from __future__ import annotations


def count_of(count: int, one: str, many: str = "") -> str:
    """Write a count with its noun: no readings, 1 reading, 2 readings.

    Parameters
    ----------
    count : int
    one : str
        The noun of a single thing.
    many : str
        Of several, where that is not the noun with an s.
    """
    return f"{count or 'no'} {one if count == 1 else many or one + 's'}"
