# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows of a cell that is swept to and fro."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.exploration.baselines import _boustrophedon_rows


@pytest.mark.parametrize(
    ("entry", "first", "second"),
    [
        ((2, 0), (2, 1), (2, 2)),
        ((3, 9), (2, 4), (2, 3)),
        ((5, 0), (6, 1), (6, 2)),
        ((6, 4), (6, 4), (6, 3)),
        ((4, 4), (2, 4), (2, 3)),
    ],
)
def test_rows_begin_at_the_corner_nearest_to_the_entry(
    entry: tuple[int, int], first: tuple[int, int], second: tuple[int, int]
) -> None:
    """Each next row begins where the last one ended; halfway up, from the first."""
    wanted = np.zeros((9, 9), dtype=np.bool_)
    wanted[2:7, 1:5] = True
    found = _boustrophedon_rows(wanted, entry)
    assert tuple(found[0]) == first
    assert tuple(found[1]) == second
    assert len(found) == len({tuple(cell) for cell in found.tolist()}) == int(wanted.sum())
    steps = np.abs(np.diff(found, axis=0)).sum(axis=1)
    assert (steps == 1).all()
