# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Meaning of recorded ranges (REP-117): limits, invalid values, no return."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats

Ranges = NDArray[np.float32]

MOST_RANGE_M = 10_000.0
"""Largest range of any lidar; an unlimited range_max would accept damaged ranges as returns."""


def range_limits(recorded: Floats, config: SourceConfig, topic: str) -> Floats:
    """Return usable (N, 2) range_min, range_max [m]: the configured ones, else the recorded.

    Rows without a usable pair are nan.

    Raises
    ------
    BadInput
        When no scan has a usable pair.
    """
    stated = stated_limits(recorded, config)
    limits = usable_limits(stated)
    if len(limits) and np.isnan(limits).all():
        low, high = (float(value) for value in stated[0])
        if not high > 0:
            raise BadInput(f"range_max is {high:g} in {topic}; set --set source.range_max_m=...")
        raise BadInput(
            f"range_min {low:g} and range_max {high:g} in {topic} leave no range; "
            "set --set source.range_min_m=... or source.range_max_m=..."
        )
    return limits


def stated_limits(
    recorded: Floats, config: SourceConfig, columns: tuple[int, int] = (0, 1)
) -> Floats:
    """Put the configured range_min, range_max [m] in the place of the recorded ones (N, M)."""
    stated = np.array(recorded, np.float64)
    for column, value in zip(columns, (config.range_min_m, config.range_max_m), strict=True):
        if value is not None:
            stated[:, column] = value
    return stated


def usable_limits(stated: Floats) -> Floats:
    """Return range_min, range_max (N, 2) [m] where they leave a range, else nan."""
    limits = np.array(stated, np.float64)
    with np.errstate(invalid="ignore"):
        limits[:, 1] = np.minimum(limits[:, 1], MOST_RANGE_M)
        usable = (limits[:, 1] > 0) & (limits[:, 1] > limits[:, 0]) & (limits[:, 0] >= 0)
    limits[~usable] = np.nan
    return limits


def clean_ranges(ranges_m: Ranges, limits_m: Floats, *, clear_on_inf: bool) -> Ranges:
    """Replace invalid ranges by nan.

    Parameters
    ----------
    ranges_m : (N, B) float32
    limits_m : (N, 2) float64
        range_min, range_max of each scan.
    clear_on_inf : bool
        Keep +inf ("nothing within range"), else replace it, too.

    Returns
    -------
    (N, B) float32
        Finite between the limits; +inf nothing found; -inf too close; nan invalid. A finite value
        beyond the limits is invalid (REP-117), which covers the "no return" codes of older lasers.
        So is 0, a code of many drivers, even where range_min is 0.
    """
    low, high = (limits_m[:, k, None].astype(np.float32) for k in (0, 1))
    with np.errstate(invalid="ignore"):
        keep = (ranges_m > 0) & (ranges_m >= low) & (ranges_m <= high) | np.isneginf(ranges_m)
        if clear_on_inf:
            keep |= np.isposinf(ranges_m)
    return np.where(keep, ranges_m, np.float32(np.nan))


def count_returns(ranges_m: Ranges) -> NDArray[np.int64]:
    """Return the number of returns (N,) of every cleaned scan."""
    return np.asarray(np.count_nonzero(np.isfinite(ranges_m), axis=1))


def describe_emptiness(recorded_m: Ranges) -> str:
    """Describe the ranges of a scan without a return, as in `1080 inf`."""
    counts = {
        "inf": int(np.count_nonzero(np.isposinf(recorded_m))),
        "-inf": int(np.count_nonzero(np.isneginf(recorded_m))),
        "nan": int(np.count_nonzero(np.isnan(recorded_m))),
        "outside the range limits": int(np.count_nonzero(np.isfinite(recorded_m))),
    }
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count) or "no beams"
