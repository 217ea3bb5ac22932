# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Boustrophedon cells against a search over runs of tiles, and what rows sweep without a gap."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from slarm_graph.exploration.floor_cells import label_floor_cells
from slarm_graph.grid import Mask

Run = tuple[int, int, int]
"""Row, and first and last column."""


def runs_of(wanted: Mask) -> list[Run]:
    found = []
    for row, tiles in enumerate(wanted):
        at = 0
        for is_wanted, group in itertools.groupby(tiles.tolist()):
            size = len(list(group))
            if is_wanted:
                found.append((row, at, at + size - 1))
            at += size
    return found


def touch(one: Run, other: Run) -> bool:
    return one[1] <= other[2] and other[1] <= one[2]


def expected(wanted: Mask, jump: float) -> np.ndarray:
    """Number cells as they begin, row by row from below."""
    labels, of_run, count = np.zeros(wanted.shape, dtype=int), dict[Run, int](), 0
    runs = runs_of(wanted)
    for run in runs:
        below = [r for r in runs if r[0] == run[0] - 1 and touch(r, run)]
        one = below[0] if len(below) == 1 else None
        if one is not None:
            above = [r for r in runs if r[0] == run[0] and touch(r, one)]
            moves = abs(run[1] - one[1]), abs(run[2] - one[2])
            one = one if len(above) == 1 and max(moves) <= jump else None
        if one is None:
            count += 1
        of_run[run] = count if one is None else of_run[one]
        labels[run[0], run[1] : run[2] + 1] = of_run[run]
    return labels


@pytest.mark.parametrize("jump", [0.0, 1.0, 2.5, np.inf])
@pytest.mark.parametrize("seed", range(12))
def test_cells_are_those_of_a_search_over_runs(seed: int, jump: float) -> None:
    rng = np.random.default_rng(seed)
    wanted = rng.random((14, 19)) < rng.uniform(0.3, 0.95)
    np.testing.assert_array_equal(label_floor_cells(wanted, jump), expected(wanted, jump))


def test_a_pillar_parts_the_floor_into_four() -> None:
    """Below it, left and right of it, above it."""
    wanted = np.ones((6, 7), dtype=np.bool_)
    wanted[2:4, 3] = False
    labels = label_floor_cells(wanted, np.inf)
    assert labels[:, 0].tolist() == [1, 1, 2, 2, 4, 4]
    assert labels[2].tolist() == [2, 2, 2, 0, 3, 3, 3]


def test_of_no_floor_there_are_no_cells() -> None:
    assert not label_floor_cells(np.zeros((3, 4), dtype=np.bool_), 1.0).any()
