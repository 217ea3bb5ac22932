# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How much a match says of the pose, beyond what the slopes at its points add up to.

Two things make the sum of squared slopes, which Gauss-Newton takes for the curvature, promise too
much. Along a bare corridor rough walls have slopes too, of both signs: their squares add up, though
the likelihood is the same a step further on. And where a crowd hides the walls, points are matched
to what they do not belong to.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from slarm_graph.frontends.scans.likelihood_grid import Lattice, LikelihoodGrid, mean_at
from slarm_graph.frontends.scans.small_pose import compose3
from slarm_graph.geometry import Floats

_AWAY_M = 0.1
"""How far away the fall-off is looked at: twice that of the likelihood of a wall, beyond its
roughness. Half of it makes intel.bag 6 % better and fr079 the same."""
_LEAST = 1e-3
"""Share of information that is left at least: 30 times the noise."""
_MISFIT = 10.0
"""Log of the variance per share of the usual fit that is missing. Where odometry is good, matches
of scans that fit 0.95, 0.75, 0.55 and 0.4 of the usual differ from it by 5, 19, 32 and 96 mm beyond
its own noise (fr-clinic) and by 3, 6, 12 and 45 mm (intel with people): 5 in the log of the noise
per whole, with tails that are wider. Half of it makes intel.bag 11 % better and fr-clinic with a
view of 90 degrees lose its way (4.1 m instead of 0.37)."""


def along_the_weakest(
    information: Floats, grid: LikelihoodGrid, points: Floats, pose: Floats
) -> Floats:
    """Lower an information along the weakest direction to what the likelihood falls off by there.

    The fall-off along the strongest direction says what the information of that direction is worth.

    Parameters
    ----------
    information : (3, 3) float64
        Of a match by its slopes, in the body frame.
    grid : LikelihoodGrid
    points : (K, 2) float64
        In the robot's frame [m].
    pose : (3,) float64
        Of the match on the grid [m, m, rad].

    Returns
    -------
    (3, 3) float64
    """
    return _lowered(information, grid.lattice, points, pose)


def of_misfit(share: float) -> float:
    """Return the share of information left to a scan that fits a share as well as usual."""
    return math.exp(-_MISFIT * max(0.0, 1.0 - share))


@njit(cache=True, nogil=True)
def _lowered(information: Floats, lattice: Lattice, points: Floats, pose: Floats) -> Floats:
    strengths, axes = np.linalg.eigh(np.ascontiguousarray(information[:2, :2]))
    if strengths[0] <= 0.0:
        return information
    drops = np.empty(2)
    for k in range(2):
        beside = 0.0
        for sign in (1.0, -1.0):
            shift = np.array([sign * _AWAY_M * axes[0, k], sign * _AWAY_M * axes[1, k], 0.0])
            there = compose3(pose, shift)
            beside = max(beside, mean_at(lattice, points, there))
        drops[k] = mean_at(lattice, points, pose) - beside
    if drops[1] <= 0.0:
        return information
    claimed = strengths[0] / strengths[1]
    share = min(1.0, max(_LEAST, max(drops[0], 0.0) / drops[1] / claimed))
    shrunk = np.eye(3)
    shrunk[:2, :2] = axes @ np.diag(np.array([math.sqrt(share), 1.0])) @ axes.T
    lowered: Floats = shrunk @ information @ shrunk.T
    return lowered
