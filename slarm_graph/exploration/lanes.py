# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cut what is still to be passed over into simple parts, and each part into parallel lanes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask

Labels = NDArray[np.int32]

_JUMP_RADII: Final = 3.0
"""Where the edge of a part jumps sideways by more, a new part begins."""
_TURN_RADII: Final = 10.0
"""What a turn at the end of a lane costs, as a length of straight driving."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of floor to be covered by parallel lanes.

    Parameters
    ----------
    lanes : tuple of (K, 2) float64
        Polylines of the robot's centre, side by side in order, all in the same sense;
        x, y [cells].
    area_cells : int
    """

    lanes: tuple[Floats, ...]
    area_cells: int


def split_into_parts(wanted: Mask, passable: Mask, radius: float, min_cells: int) -> list[Part]:
    """Cut the wanted cells into parts, along rows or columns, whichever needs fewer turns.

    A boustrophedon decomposition (Choset 2000): a part ends where a run of wanted cells splits,
    merges or jumps. Every part gets the lane direction that gives it fewer lanes.

    Parameters
    ----------
    wanted : (rows, cols) bool
        What the disc has still to pass over.
    passable : (rows, cols) bool
        Where the centre may be.
    radius : float
        Of the disc [cells].
    min_cells : int
        Smaller parts are dropped.
    """
    by_rows = _parts(wanted, radius, min_cells)
    by_cols = _parts(wanted.T, radius, min_cells)
    turned = _cost(by_cols[1], radius) < _cost(by_rows[1], radius)
    labels, boxes = by_cols if turned else by_rows
    free = np.ascontiguousarray(passable.T if turned else passable)
    parts = []
    for label, box in boxes:
        part = _with_lanes(labels, label, box, free, radius)
        if part is not None:
            parts.append(_transposed(part) if turned else part)
    return parts


def label_parts(wanted: Mask, jump: float) -> Labels:
    """Label (rows, cols) the parts that rows split into, from 1; 0 where not wanted.

    Parameters
    ----------
    wanted : (rows, cols) bool
    jump : float
        A part ends where its edge moves sideways by more [cells].
    """
    labels = np.zeros(wanted.shape, dtype=np.int32)
    _label_runs(np.ascontiguousarray(wanted), labels, jump)
    return labels


def coverable(passable: Mask, radius: float) -> Mask:
    """Cells that the disc can pass over from passable cells."""
    away = cv2.distanceTransform((~passable).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away <= radius)


def _parts(wanted: Mask, radius: float, min_cells: int) -> tuple[Labels, list[tuple[int, Floats]]]:
    """Label parts; boxes hold row_min, row_max, col_min, col_max, area."""
    wanted = np.ascontiguousarray(wanted)
    labels = np.zeros(wanted.shape, dtype=np.int32)
    boxes = _label_runs(wanted, labels, _JUMP_RADII * radius)
    return labels, [(i + 1, box) for i, box in enumerate(boxes) if box[4] >= min_cells]


def _cost(boxes: list[tuple[int, Floats]], radius: float) -> float:
    """Price of turns and of strips that lanes waste."""
    return sum(_TURN_RADII * radius * _lane_count(box, radius)[0] for _, box in boxes)


def _lane_count(box: Floats, radius: float) -> tuple[int, bool]:
    """Fewer of the lanes along rows and along columns, and whether it is along columns."""
    along_rows = math.ceil(round((box[1] - box[0] + 1) / (2.0 * radius), 2))
    along_cols = math.ceil(round((box[3] - box[2] + 1) / (2.0 * radius), 2))
    return min(along_rows, along_cols), along_cols < along_rows


def _with_lanes(
    labels: Labels, label: int, box: Floats, passable: Mask, radius: float
) -> Part | None:
    margin = math.ceil(radius) + 1
    low_row, low_col = max(0, int(box[0]) - margin), max(0, int(box[2]) - margin)
    window = (
        slice(low_row, int(box[1]) + margin + 1),
        slice(low_col, int(box[3]) + margin + 1),
    )
    mine, free = labels[window] == label, passable[window]
    count, along_cols = _lane_count(box, radius)
    if along_cols:
        mine, free = mine.T, free.T
    mine, free = np.ascontiguousarray(mine), np.ascontiguousarray(free)
    lanes = []
    rows = np.flatnonzero(mine.any(axis=1))
    first, height = rows[0], rows[-1] - rows[0] + 1
    for i in range(count):
        low, high = first + height * i / count, first + height * (i + 1) / count
        lane = _lane(mine, free, low, high, radius)
        if len(lane):
            lanes.append((lane[:, ::-1] if along_cols else lane) + (low_col, low_row))
    return Part(tuple(lanes), int(box[4])) if lanes else None


def _transposed(part: Part) -> Part:
    return Part(tuple(lane[:, ::-1] for lane in part.lanes), part.area_cells)


@njit(cache=True, nogil=True)
def _label_runs(wanted: Mask, labels: Labels, jump: float) -> list[Floats]:
    """Sweep upwards; a run goes on with the part below it when each touches only the other."""
    rows, cols = wanted.shape
    boxes = [np.zeros(5)][:0]
    before = np.zeros((0, 3), dtype=np.int64)
    for r in range(rows):
        runs = np.zeros((cols // 2 + 1, 3), dtype=np.int64)
        count = 0
        c = 0
        while c < cols:
            if wanted[r, c]:
                begin = c
                while c < cols and wanted[r, c]:
                    c += 1
                runs[count, 0] = begin
                runs[count, 1] = c - 1
                count += 1
            c += 1
        runs = runs[:count]
        touched = np.zeros(len(before), dtype=np.int64)
        first = np.full(count, -1, dtype=np.int64)
        touching = np.zeros(count, dtype=np.int64)
        j = 0
        for i in range(count):
            while j < len(before) and before[j, 1] < runs[i, 0]:
                j += 1
            k = j
            while k < len(before) and before[k, 0] <= runs[i, 1]:
                touched[k] += 1
                touching[i] += 1
                first[i] = k
                k += 1
        for i in range(count):
            k = first[i]
            goes_on = (
                touching[i] == 1
                and touched[k] == 1
                and abs(runs[i, 0] - before[k, 0]) <= jump
                and abs(runs[i, 1] - before[k, 1]) <= jump
            )
            if goes_on:
                label = before[k, 2]
            else:
                boxes.append(np.array([r, r, runs[i, 0], runs[i, 1], 0.0]))
                label = len(boxes)
            runs[i, 2] = label
            box = boxes[label - 1]
            box[1] = r
            box[2] = min(box[2], runs[i, 0])
            box[3] = max(box[3], runs[i, 1])
            box[4] += runs[i, 1] - runs[i, 0] + 1
            labels[r, runs[i, 0] : runs[i, 1] + 1] = label
        before = runs
    return boxes


@njit(cache=True, nogil=True)
def _lane(mine: Mask, free: Mask, low: float, high: float, radius: float) -> Floats:
    """Centre line (K, 2) x, y that covers the strip low <= y < high of a part.

    It keeps to the middle of the strip where the centre may be there, and goes to the nearest
    passable row else.
    """
    rows, cols = mine.shape
    middle = 0.5 * (low + high)
    first, last = cols, -1
    for r in range(int(low), min(rows, math.ceil(high))):
        for c in range(cols):
            if mine[r, c]:
                first = min(first, c)
                last = max(last, c)
    if last < 0:
        return np.empty((0, 2))
    half = 0.5 * (high - low)
    # The disc covers the end of the strip to its edges from this far away.
    spare = math.sqrt(max(0.0, radius * radius - half * half))
    begin, end = first + spare, last + 1 - spare
    if begin > end:
        begin = end = 0.5 * (begin + end)
    points = np.empty((cols + 2, 2))
    count = 0
    first_col, last_col = int(begin), int(min(end, cols - 1e-9))
    for c in range(first_col, last_col + 1):
        best, best_off = -1.0, radius + 1.0
        for r in range(max(0, int(middle - radius)), min(rows, int(middle + radius) + 1)):
            if free[r, c]:
                off = abs(r + 0.5 - middle)
                if int(middle) == r:
                    best, best_off = middle, 0.0
                elif off < best_off:
                    best, best_off = r + 0.5, off
        if best >= 0.0:
            x = c + 0.5
            points[count, 0] = x
            points[count, 1] = best
            count += 1
    return points[:count]
