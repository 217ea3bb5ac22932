# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Static returns: those of a keyframe where other keyframes nearby on the path had some, too.

A wall is observed again from the next poses; of passers-by each scan shows others, or elsewhere. So
a place looks the same without them, however many there were.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import MatchingConfig
from slarm_graph.frontends.scans.likelihood_grid import scan_segments
from slarm_graph.frontends.scans.submaps import Keyframe
from slarm_graph.geometry import Floats, transform_points
from slarm_graph.kernels import kernel
from slarm_graph.raster.firsts import first_in_cells

_CELL_M = 0.25
"""Cell that a static return is observed in repeatedly: a passer-by leaves it in half a second."""
_SEEN_BY, CONFIRMED_WITHIN = 3, 10
"""Keyframes that must have observed it, of so many in a row: 2.5 m in a dense recording. Of ten
passers-by about the robot, who cover a fiftieth of the cells nearby at a time, 2 % then stay."""

_Cells = NDArray[np.int64]


def static_returns(keyframes: Sequence[Keyframe], matching: MatchingConfig) -> list[Keyframe]:
    """Return the keyframes with only those returns that neighbouring keyframes confirm.

    Parameters
    ----------
    keyframes : sequence of Keyframe
    matching : MatchingConfig
        A keyframe of which fewer returns than its `min_points` are confirmed keeps all of them.

    Returns
    -------
    list of Keyframe
    """
    poses = [k.local_from_robot.as_array() for k in keyframes]
    occupied = [
        _occupied_cells(scan_segments(k.points_m, pose, matching.max_gap_m))
        for k, pose in zip(keyframes, poses, strict=True)
    ]
    counts = [len(t) for t in occupied]
    is_confirmed = _seen_repeatedly(
        np.concatenate(occupied), np.repeat(np.arange(len(occupied)), counts)
    )
    kept = []
    parts = np.split(is_confirmed, np.cumsum(counts)[:-1])
    for keyframe, pose, cells, is_static in zip(keyframes, poses, occupied, parts, strict=True):
        cells_of_points = _packed(transform_points(pose, keyframe.points_m))
        points = keyframe.points_m[_among(cells_of_points, np.sort(cells[is_static]))]
        enough = len(points) >= matching.min_points
        kept.append(replace(keyframe, points_m=points) if enough else keyframe)
    return kept


@kernel
def _occupied_cells(segments: Floats) -> _Cells:
    """Cells that segments (S, 4) [m] pass, each once; sampled twice per cell."""
    count = 0
    for k in range(len(segments)):
        count += _steps(segments, k)
    sampled = np.empty((count, 2))
    count = 0
    for k in range(len(segments)):
        steps = _steps(segments, k)
        for i in range(steps):
            share = i / max(steps - 1, 1)
            for axis in range(2):
                start, end = segments[k, axis], segments[k, axis + 2]
                sampled[count, axis] = start + share * (end - start)
            count += 1
    return _packed(sampled[first_in_cells(sampled, _CELL_M)])


@kernel
def _steps(segments: Floats, k: int) -> int:
    length_m = math.hypot(segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1])
    return 1 + math.ceil(2.0 * length_m / _CELL_M)


@kernel
def _packed(points: Floats) -> _Cells:
    """One number (K,) for the cell of each point (K, 2) [m]."""
    packed = np.empty(len(points), dtype=np.int64)
    for i in range(len(points)):
        col, row = math.floor(points[i, 0] / _CELL_M), math.floor(points[i, 1] / _CELL_M)
        packed[i] = col * (1 << 31) + row
    return packed


def _among(cells: _Cells, known: _Cells) -> NDArray[np.bool_]:
    """Which of some cells (K,) are among known ones (M,) in rising order."""
    if not len(known):
        return np.zeros(len(cells), dtype=np.bool_)
    is_known: NDArray[np.bool_] = known[np.searchsorted(known[:-1], cells)] == cells
    return is_known


def _seen_repeatedly(cells: _Cells, observers: _Cells) -> NDArray[np.bool_]:
    """Which observations (M,) of a cell lie in a dense enough run of keyframes observing it."""
    order = np.lexsort((observers, cells))
    cell, observer = cells[order], observers[order]
    last = _SEEN_BY - 1
    is_near = observer[last:] - observer[:-last] < CONFIRMED_WITHIN
    is_dense_from = (cell[last:] == cell[:-last]) & is_near
    is_dense = np.zeros(len(cells), dtype=np.bool_)
    for shift in range(_SEEN_BY):
        is_dense[shift : len(is_dense) - last + shift] |= is_dense_from
    is_static = np.zeros(len(cells), dtype=np.bool_)
    is_static[order] = is_dense
    return is_static
