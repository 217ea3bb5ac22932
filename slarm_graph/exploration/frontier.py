# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Go and see: the border between what is known and what is not (Yamauchi 1997)."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from slarm_graph.exploration.coverage_grid import OPEN, CoverageGrid, DrivingGrid, driving_cell
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.searches import reachable
from slarm_graph.exploration.ways import way_to_nearest, without_straight_points
from slarm_graph.geometry import Pose2
from slarm_graph.grid import Mask

_REVIEW_S: Final = 1.0
_MIN_PATCH_CELLS: Final = 3


class NearestFrontier:
    """Baseline: drive to the nearest frontier until none is left; what was seen counts as known."""

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Look at the nearest unknown cells."""
        start = driving_cell(coverage.driving, pose.x, pose.y)
        if start is None:
            return Finished("no free cell near the robot", int(np.sum(coverage.codes == OPEN)))
        near = reachable(coverage.driving.moves, start)
        leg = look_at_unknown(coverage.driving, near, pose)
        return leg or Finished("everything reachable has been seen", unseen_cells(coverage, near))


def look_at_unknown(driving: DrivingGrid, near: Mask, pose: Pose2) -> Leg | None:
    """Go to where unknown cells can be seen from, the nearest such place first.

    Parameters
    ----------
    driving : DrivingGrid
    near : (rows, cols) bool
        Driving cells that can be reached.
    pose : Pose2
    """
    edge = frontier(driving) & near
    way = way_to_nearest(driving, pose.as_array()[:2], edge) if edge.any() else None
    if way is None:
        return None
    way = without_straight_points(way)
    return Leg(way, review_s=_REVIEW_S) if len(way) > 1 else None


def frontier(driving: DrivingGrid) -> Mask:
    """Passable cells (rows, cols) in or beside a patch of cells of which nothing is known."""
    beside = ~(driving.observed | driving.occupied) & driving.passable
    count, labels, stats, _ = cv2.connectedComponentsWithStats(beside.astype(np.uint8))
    small = stats[:count, cv2.CC_STAT_AREA] < _MIN_PATCH_CELLS
    beside &= ~small[labels]
    grown = cv2.dilate(beside.astype(np.uint8), np.ones((3, 3), dtype=np.uint8)) > 0
    return np.asarray(grown & driving.passable)


def unseen_cells(coverage: CoverageGrid, near: Mask) -> int:
    """Count coverage cells of which nothing is known and which cannot be reached."""
    driving = coverage.driving
    unseen = ~(driving.observed | driving.occupied | near)
    rows, cols = coverage.geometry.shape
    fine = coverage.fineness
    return int(unseen.reshape(rows, fine, cols, fine).all(axis=(1, 3)).sum())
