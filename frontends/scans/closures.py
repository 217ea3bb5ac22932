# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure's input and output: predicted candidates and closures, and the gate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats

GATE_CHI2 = 30.66
"""Chi-square quantile of 1 - 1e-6 for 3 degrees of freedom: tracking errors have heavy tails. In
graphs without a false closure up to 3 % of the true candidates lie beyond (a hall seen 8 m deep),
of the false ones up to 1 % within. With half a hall is 0.34 m in place of 0.09, with double a
ward 0.12 in place of 0.38; eight others move by 15 % at most."""
GATE_SIGMAS = math.sqrt(GATE_CHI2)
"""Standard deviations of the predicted pose within which closures are searched."""
COVISIBLE_M, _DISTANCE_BIN_M = 3.0, 1.0
"""Distance of the view centres of a submap and a keyframe that show the same walls, and bin in
which distances count as equal. Half and double move edmonton by 3 % at most; with either, mit-csail
hard_1_of_2 falls from one outcome (0.041 m) to another (0.033), plain it stays."""


@dataclass(frozen=True, slots=True)
class ClosureCandidates:
    """Loop closure candidates: a keyframe's predicted poses in old submaps, nearest first.

    Parameters
    ----------
    submap : (E,) int64
    submap_from_keyframe : (E, 3) float64
    sigma_m, sigma_rad : (E,) float64
        Standard deviations of position and heading.
    """

    submap: NDArray[np.int64]
    submap_from_keyframe: Floats
    sigma_m: Floats
    sigma_rad: Floats

    @staticmethod
    def none() -> ClosureCandidates:
        """Return no candidates: no old submap is within reach."""
        empty = np.zeros(0)
        return ClosureCandidates(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), empty, empty)


def covisible_submaps(centers_m: Floats, view_m: Floats, bounds_m: Floats) -> NDArray[np.int64]:
    """Submaps that may show the walls of a view, nearest first.

    Of equally near ones the oldest first: later visits are then all tied to the first one.

    Parameters
    ----------
    centers_m : (N, 2) float64
        View centres of the submaps in the map [m].
    view_m : (2,) float64
        That of the view [m].
    bounds_m : (N,) float64
        How far each may lie from where it is believed to be [m].
    """
    distance_m = np.hypot(*(centers_m - view_m).T)
    near = np.flatnonzero(distance_m < COVISIBLE_M + bounds_m)
    return near[np.lexsort((near, np.floor(distance_m[near] / _DISTANCE_BIN_M)))]


@dataclass(frozen=True, slots=True)
class Closure:
    """A keyframe matched in an old submap: a loop closure, accepted or rejected.

    Parameters
    ----------
    submap, keyframe : int
    submap_from_keyframe : (3,) float64
    information : (3, 3) float64
        In the keyframe's body frame.
    score : float
        Mean likelihood, 0 to 1.
    searched : bool
        Found by a correlative search, not from the predicted pose.
    reason : str
        Why it was rejected; empty when it was accepted.
    """

    submap: int
    keyframe: int
    submap_from_keyframe: Floats
    information: Floats
    score: float
    searched: bool
    reason: str = ""
