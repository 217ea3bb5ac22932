# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Boustrophedon cellular decomposition (Choset 2000) of a floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel

Labels = NDArray[np.int32]


def label_floor_cells(wanted: Mask, jump: float) -> Labels:
    """Label (rows, cols) the cells of a floor from 1; 0 where it is not wanted.

    A cell ends where a run of wanted tiles splits, merges or jumps.

    Parameters
    ----------
    wanted : (rows, cols) bool
    jump : float
        The most by which the edge of a cell may move sideways between rows [tiles].
    """
    labels = np.zeros(wanted.shape, dtype=np.int32)
    _label_runs(np.ascontiguousarray(wanted), labels, jump)
    return labels


@kernel
def _label_runs(wanted: Mask, labels: Labels, jump: float) -> None:
    """Sweep upwards; a run continues the cell below it when each touches only the other."""
    before = np.zeros((0, 3), dtype=np.int64)
    last_label = 0
    for r in range(wanted.shape[0]):
        runs = _runs_of(wanted[r])
        below, above, neighbour = _touching(runs, before)
        for i in range(len(runs)):
            k = neighbour[i]
            goes_on = (
                below[i] == 1
                and above[k] == 1
                and abs(runs[i, 0] - before[k, 0]) <= jump
                and abs(runs[i, 1] - before[k, 1]) <= jump
            )
            if not goes_on:
                last_label += 1
            runs[i, 2] = before[k, 2] if goes_on else last_label
            labels[r, runs[i, 0] : runs[i, 1] + 1] = runs[i, 2]
        before = runs


@kernel
def _runs_of(row: Mask) -> NDArray[np.int64]:
    """First and last column of every run (N, 3) of a row; the third column is for its label."""
    cols = len(row)
    runs = np.zeros((cols // 2 + 1, 3), dtype=np.int64)
    count, c = 0, 0
    while c < cols:
        if row[c]:
            runs[count, 0] = c
            while c < cols and row[c]:
                c += 1
            runs[count, 1] = c - 1
            count += 1
        c += 1
    return runs[:count]


@kernel
def _touching(
    runs: NDArray[np.int64], before: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Number of neighbours below each run, and above each run below; index of the last below.

    Index -1 stands for no neighbour.
    """
    below = np.zeros(len(runs), dtype=np.int64)
    above = np.zeros(len(before), dtype=np.int64)
    last = np.full(len(runs), -1, dtype=np.int64)
    j = 0
    for i in range(len(runs)):
        while j < len(before) and before[j, 1] < runs[i, 0]:
            j += 1
        k = j
        while k < len(before) and before[k, 0] <= runs[i, 1]:
            above[k] += 1
            below[i] += 1
            last[i] = k
            k += 1
    return below, above, last
