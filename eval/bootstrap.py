# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bootstrap confidence intervals of means and of root mean squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slarm_graph.geometry import Floats

_REPEATS = 1000
"""Resamplings; with half as many the ends of an interval vary by about 3 % of its width."""
_BLOCKS = 20
"""Neighbouring errors are correlated, so that whole stretches are drawn, this many per path.
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
        Draw that many circular stretches instead of single values, where neighbours are
        correlated.
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


def nested_interval(groups: Sequence[Floats], seed: int = 0) -> Interval:
    """Return the 95 % bootstrap interval of the mean of all values in groups.

    Groups are drawn, then values in each: values of one group (the seeds of one recording) are
    correlated and do not count as so many groups. NaN where there is nothing to draw from: one
    group whose values are all the same.

    Parameters
    ----------
    groups : sequence of (N_i,) float64
        None of them empty.
    seed : int
    """
    counts = np.array([len(group) for group in groups])
    if len(groups) == 0 or (len(groups) == 1 and np.ptp(groups[0]) == 0.0):
        return float("nan"), float("nan")
    padded = np.zeros((len(groups), counts.max()))
    for row, group in zip(padded, groups, strict=True):
        row[: len(group)] = group
    rng = np.random.default_rng(seed)
    chosen = rng.integers(0, len(groups), (_REPEATS, len(groups)))
    sizes = counts[chosen][..., None]
    picks = (rng.random((*chosen.shape, counts.max())) * sizes).astype(np.int64)
    drawn = padded[chosen[..., None], picks]
    drawn[np.arange(counts.max()) >= sizes] = 0.0
    means = drawn.sum(axis=(1, 2)) / sizes.sum(axis=(1, 2))
    low, high = np.quantile(means, _QUANTILES)
    return float(low), float(high)
