# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Integer nanoseconds to decimal text and back, never through a float."""

from __future__ import annotations

NS_PER_S = 1_000_000_000
"""Stamps are whole nanoseconds, as in ROS."""
LATEST_S = 9.2e9
"""What fits into a signed 64-bit number of nanoseconds: until the year 2261."""


def seconds_to_ns(text: str) -> int:
    """Convert decimal seconds to integer nanoseconds; digits past the ninth are cut.

    Raises
    ------
    ValueError
        When the text is not a plain or scientific decimal number, or no time that fits into 64
        bits.
    """
    whole, _, fraction = text.strip().partition(".")
    if not abs(float(text)) < LATEST_S:
        raise ValueError("stamp is not a finite number of seconds")
    if not fraction.isdigit() or not whole.lstrip("+-").isdigit():
        return round(float(text) * NS_PER_S)
    nanoseconds = int(fraction[:9].ljust(9, "0"))
    return int(whole) * NS_PER_S + (-nanoseconds if whole.startswith("-") else nanoseconds)


def ns_to_seconds(stamp_ns: int) -> str:
    """Write nanoseconds as seconds with all nine decimals."""
    whole, nanoseconds = divmod(abs(int(stamp_ns)), NS_PER_S)
    return f"{'-' if stamp_ns < 0 else ''}{whole}.{nanoseconds:09d}"
