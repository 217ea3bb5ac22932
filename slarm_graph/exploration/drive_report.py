# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cost of a drive: length, turns, revisits, time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from slarm_graph.geometry import wrap_angles
from slarm_graph.grid import GridGeometry
from slarm_graph.trajectory import Trajectory

_TURN_RAD: Final = math.radians(45.0)
"""Least change of heading that counts as a turn: half a right angle."""
_STILL_RAD: Final = math.radians(1.0)
"""Smaller changes between readings are noise of the heading, not the direction of a turn."""


@dataclass(frozen=True, slots=True)
class DriveReport:
    """The cost of an exploration.

    Parameters
    ----------
    path_length_m : float
    turns : int
        Bends of 45 degrees and more, on the spot or on the move.
    revisit_share : float
        Share of the cells entered that had been entered before, 0 to 1.
    drive_time_s : float
        Simulated time from the first to the last reading.
    collisions : int
        Contacts with the true world.
    planning_s : float
        Processor time of the explorer's decisions.
    """

    path_length_m: float
    turns: int
    revisit_share: float
    drive_time_s: float
    collisions: int
    planning_s: float = 0.0


def drive_report(
    driven: Trajectory, geometry: GridGeometry, collisions: int, planning_s: float = 0.0
) -> DriveReport:
    """Compute the cost of a drive, revisits on the cells of a grid."""
    span_s = float(driven.stamps_ns[-1] - driven.stamps_ns[0]) * 1e-9
    length_m = driven.path_length_m()
    revisits = revisit_share(driven, geometry)
    return DriveReport(length_m, count_turns(driven), revisits, span_s, collisions, planning_s)


def count_turns(driven: Trajectory) -> int:
    """Count runs of rotation to one side that add up to 45 degrees or more."""
    step = wrap_angles(np.diff(driven.poses[:, 2]))
    side = np.where(np.abs(step) > _STILL_RAD, np.sign(step), 0.0)
    starts = np.flatnonzero(np.diff(side, prepend=0.0))
    if not len(starts):
        return 0
    return int(np.sum(np.abs(np.add.reduceat(step * (side != 0), starts)) >= _TURN_RAD))


def revisit_share(driven: Trajectory, geometry: GridGeometry) -> float:
    """Share of cell entries that lead into a cell entered before."""
    cells = geometry.cell_of(driven.poses[:, :2])
    entered = np.concatenate([[True], np.any(np.diff(cells, axis=0) != 0, axis=1)])
    visits = cells[entered]
    return 1.0 - len(np.unique(visits, axis=0)) / len(visits)
