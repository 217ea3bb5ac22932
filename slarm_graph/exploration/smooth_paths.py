# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Smooth paths by a moving average, so that they can be driven without a stop.

A lane is smoothed only as much as the stairs of cells need, and its sharp corners stay, as the
floor in a corner is worth the turn. Links between lanes have no floor to cover and are smoothed
more.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.exploration.coverage_grid import DrivingGrid
from slarm_graph.exploration.paths import without_collinear_points
from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask

_STEP_M: Final = 0.02
"""Spacing of points along a path: half of a driving cell and less."""
_LANE_REACH: Final = round(0.09 / _STEP_M)
"""Half-width of the average over a lane [steps]: a little more than a stair of 0.05 m."""
_LINK_REACH: Final = round(0.18 / _STEP_M)
"""Half-width of the average over a link [steps]: twice that of a lane."""
_CORNER_REACH: Final = round(0.16 / _STEP_M)
"""Length on either side over which the angle of a corner is measured, about a robot's radius."""
_CORNER_RAD: Final = math.radians(60.0)
"""A lane that bends by more within the reach to either side has a corner."""

Reaches = NDArray[np.int64]


def smooth_path(pieces: list[tuple[Floats, bool]], driving: DrivingGrid) -> Floats:
    """Join pieces into one path (K, 2) [m] and smooth it.

    Parameters
    ----------
    pieces : list of ((N, 2) float64, bool)
        Corners [m], each piece beginning where the one before ends; and whether it is a link.
    driving : DrivingGrid
        A link is rounded only where the rounded one is passable.
    """
    points = without_collinear_points(np.concatenate([piece for piece, _ in pieces]), 0.0)
    if len(points) < 2:
        return points
    points, is_link = _resampled(pieces)
    lane_reach = np.minimum(_LANE_REACH, _steps_to_corner(points, ~is_link))
    beside_link = _grown(is_link, _LINK_REACH)
    reach = np.where(beside_link, _LINK_REACH, lane_reach)
    rough = beside_link & ~_is_passable(_averaged(points, reach), driving)
    reach = np.where(_grown(rough, _LINK_REACH), lane_reach, reach)
    rough = is_link & ~_is_passable(_averaged(points, reach), driving)
    return without_collinear_points(_averaged(points, np.where(rough, 0, reach)))


def _resampled(pieces: list[tuple[Floats, bool]]) -> tuple[Floats, Mask]:
    """Points (K, 2) [m] a step apart, and which of them lie on a link."""
    out, links = [pieces[0][0][:1]], [np.array([pieces[0][1]])]
    for piece, is_link in pieces:
        along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(piece, axis=0).T))])
        count = math.ceil(along_m[-1] / _STEP_M)
        at_m = np.linspace(0.0, along_m[-1], count + 1)[1:]
        out.append(np.stack([np.interp(at_m, along_m, piece[:, k]) for k in (0, 1)], axis=-1))
        links.append(np.full(count, is_link))
    return np.concatenate(out), np.concatenate(links)


def _steps_to_corner(points: Floats, where: Mask) -> Reaches:
    """Steps (K,) from every point to the nearest sharp corner among some of them."""
    here, last = np.arange(len(points)), len(points) - 1
    into = points - points[np.maximum(here - _CORNER_REACH, 0)]
    out = points[np.minimum(here + _CORNER_REACH, last)] - points
    cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    bend = np.abs(np.arctan2(cross, (into * out).sum(axis=1)))
    sharpest = cv2.dilate(bend[None], np.ones((1, 2 * _CORNER_REACH + 1)))[0]
    corners = np.flatnonzero(where & (bend >= sharpest) & (bend > _CORNER_RAD))
    if not len(corners):
        return np.full(len(points), len(points))
    after = np.minimum(np.searchsorted(corners, here), len(corners) - 1)
    before = np.maximum(after - 1, 0)
    steps = np.minimum(np.abs(here - corners[after]), np.abs(here - corners[before]))
    return np.asarray(steps, dtype=np.int64)


def _grown(marks: Mask, reach: int) -> Mask:
    """Marks (K,) dilated by so many steps to both sides."""
    grown = cv2.dilate(marks.astype(np.uint8)[None], np.ones((1, 2 * reach + 1), dtype=np.uint8))
    return np.asarray(grown[0] > 0)


def _averaged(points: Floats, reach: Reaches) -> Floats:
    """Moving average of points (K, 2) over a half-width (K,); the ends stay."""
    here = np.arange(len(points))
    reach = np.minimum(reach, np.minimum(here, len(points) - 1 - here))
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    mean = (total[here + reach + 1] - total[here - reach]) / (2 * reach + 1)[:, None]
    return np.asarray(mean)


def _is_passable(points_m: Floats, driving: DrivingGrid) -> Mask:
    cells = driving.geometry.cell_of(points_m)
    inside = driving.geometry.contains(cells)
    passable = np.zeros(len(points_m), dtype=np.bool_)
    passable[inside] = driving.passable[cells[inside, 0], cells[inside, 1]]
    return passable
