# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A pose for every scan out of corrected poses for some."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats, between, compose


def fill_path(
    stamps_ns: NDArray[np.int64], local: Floats, corrected: NDArray[np.int64], path: Floats
) -> Floats:
    """Carry a smooth path over to corrected poses; what is left of a step is spread over time.

    Parameters
    ----------
    stamps_ns : (N,) int64
    local : (N, 3) float64
        `local_from_robot` at every scan, smooth but drifting.
    corrected : (U,) int64
        Increasing indices of the scans with a corrected pose; the first is 0.
    path : (U, 3) float64
        Their `map_from_robot`.

    Returns
    -------
    (N, 3) float64
        `map_from_robot` at every scan, equal to `path` at the corrected ones.
    """
    scans = np.arange(len(stamps_ns))
    step = np.searchsorted(corrected, scans, side="right") - 1
    filled = compose(path[step], between(local[corrected[step]], local))
    if len(corrected) < 2:
        return filled
    left = compose(path[:-1], between(local[corrected[:-1]], local[corrected[1:]]))
    residual = np.concatenate([between(left, path[1:]), np.zeros((1, 3))])
    span_ns = np.append(np.diff(stamps_ns[corrected]), 1)
    share = (stamps_ns - stamps_ns[corrected[step]]) / span_ns[step]
    return compose(filled, share[:, None] * residual[step])
