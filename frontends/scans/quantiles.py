# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Quantiles of some hundred values inside compiled loops, where numpy's own take 50 us to begin.

They are found by partition (Hoare, "Algorithm 65: Find", CACM 4(7), 1961); numba's `np.partition`
takes seconds to compile.
"""

from __future__ import annotations

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel


@kernel
def quantile(values: Floats, share: float) -> float:
    """Return the value of (N,), N > 0, below which a share of them lies, as `np.quantile` does."""
    rank = share * (len(values) - 1)
    lower, upper = _ranked(values.copy(), int(rank))
    part = rank - int(rank)
    # From the nearer end, as numpy rounds.
    if part < 0.5:
        return lower + (upper - lower) * part
    return upper - (upper - lower) * (1.0 - part)


@kernel
def median(values: Floats) -> float:
    """Return the median of values (N,), N > 0, as `np.median` does."""
    middle = (len(values) - 1) // 2
    lower, upper = _ranked(values.copy(), middle)
    return 0.5 * (lower + upper) if len(values) % 2 == 0 else lower


@kernel
def _ranked(values: Floats, rank: int) -> tuple[float, float]:
    """Value of that rank and the one after it, if there is one; the values (N,) are reordered."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    following = values[min(rank + 1, len(values) - 1)]
    for i in range(rank + 1, len(values)):
        following = min(following, values[i])
    return values[rank], following
