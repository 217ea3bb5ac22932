# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Searches over cells against scipy's, and steering that is the same wherever the map begins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.moves import DELTA_COL, DELTA_ROW
from slarm_graph.exploration.path_follower import PathFollower
from slarm_graph.exploration.searches import new_labels, wavefront
from slarm_graph.geometry import Pose2

SIDE = 9


def moves_of(rng: np.random.Generator, share: float, directions: range) -> np.ndarray:
    """Draw which steps are allowed from every cell, never out of the grid."""
    moves = np.zeros((SIDE, SIDE), dtype=np.uint8)
    for row, col in np.ndindex(SIDE, SIDE):
        for d in directions:
            there = row + DELTA_ROW[d], col + DELTA_COL[d]
            if min(there) >= 0 and max(there) < SIDE and rng.random() < share:
                moves[row, col] |= 1 << d
    return moves


def costs(moves: np.ndarray, start: int) -> np.ndarray:
    """Cost of the way to every cell by scipy, a diagonal step being the root of two."""
    table = np.zeros((SIDE * SIDE, SIDE * SIDE))
    for row, col in np.ndindex(SIDE, SIDE):
        for d in range(8):
            if (moves[row, col] >> d) & 1:
                there = (row + DELTA_ROW[d]) * SIDE + col + DELTA_COL[d]
                table[row * SIDE + col, there] = math.sqrt(2.0) if d % 2 else 1.0
    return np.asarray(dijkstra(csr_matrix(table), indices=start))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("directions", [range(8), range(1, 8, 2)])
def test_the_wave_finds_the_cheapest_wanted_cell(seed: int, directions: range) -> None:
    """Diagonal steps alone as well: then nothing is ever within the next bucket."""
    rng = np.random.default_rng(seed)
    moves = moves_of(rng, 0.7, directions)
    codes = (rng.random((SIDE, SIDE)) < 0.08).astype(np.uint8).ravel()
    start = int(rng.integers(SIDE * SIDE))
    codes[start] = 0
    expected = costs(moves, start)
    wanted = np.flatnonzero(codes)
    found = wavefront(moves, codes, 1, start, math.inf, new_labels(SIDE * SIDE), 1)
    if len(wanted) and np.isfinite(expected[wanted]).any():
        assert expected[found] == pytest.approx(expected[wanted].min())
        assert codes[found] == 1
    else:
        assert found == -1


def test_steering_does_not_depend_on_where_the_map_begins() -> None:
    path = np.array([[0.0, 0.0], [1.0, 0.2], [2.0, 1.0], [2.5, 2.5]])
    start = Pose2(0.05, 0.08, 0.1)
    commands = []
    for origin in (Pose2(), Pose2(40.0, -17.0, 0.0), Pose2(3.0, 9.0, 2.2)):
        follower = PathFollower(DrivingConfig())
        follower.follow(origin.transform(path))
        command = follower.command(origin @ start, 0.1)
        commands.append([command.speed_m_s, command.turn_rate_rad_s])
    np.testing.assert_allclose(commands, [commands[0]] * 3, atol=1e-9)
    assert commands[0][0] > 0.0
