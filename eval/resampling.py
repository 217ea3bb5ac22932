# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bootstrap intervals: how far a figure would move, had other data of the same kind come."""

from __future__ import annotations

import numpy as np

from slarm_graph.geometry import Floats

_REPEATS = 1000
"""Resamplings; with half as many the ends of an interval shake by about 3 % of its width."""
_BLOCKS = 20
"""Neighbouring errors resemble each other, so that whole stretches are drawn, this many a path.
Half as many give unsteady intervals, twice as many too narrow ones where errors drift slowly."""
_QUANTILES = (0.025, 0.975)
"""Ends of the central 95 %, the usual confidence interval."""

Interval = tuple[float, float]


def mean_interval(values: Floats, *, blocks: int | None = None, seed: int = 0) -> Interval:
    """Return the 95 % bootstrap interval of the mean of values (N,).

    Parameters
    ----------
    values : (N,) float64
    blocks : int, optional
        Draw that many circular stretches instead of single values, where neighbours depend on
        each other.
    seed : int
    """
    count = len(values)
    if count < 2:
        return float("nan"), float("nan")
    block = 1 if blocks is None else max(1, count // blocks)
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, count, (_REPEATS, -(-count // block)))
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([values, values[:block]]))])
    means = (sums[starts + block] - sums[starts]).mean(axis=1) / block
    low, high = np.quantile(means, _QUANTILES)
    return float(low), float(high)


def rms_interval(errors: Floats, seed: int = 0) -> Interval:
    """Return the 95 % interval of the root mean square of errors (N,) along a path."""
    low, high = mean_interval(errors * errors, blocks=_BLOCKS, seed=seed)
    return float(np.sqrt(max(low, 0.0))), float(np.sqrt(max(high, 0.0)))
