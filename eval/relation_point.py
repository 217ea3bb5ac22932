# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Detection of relations that were measured at another point of the robot than assumed.

Seen from a point `o` of a body that moved by (t, R), its displacement is t + (R - 1) o. A reference
made with another mounting of the laser, or with its sign turned, differs from a right trajectory by
that alone, in proportion to how far the body turned. It takes few relations between drives in
opposite directions to find `o` to a centimetre.
"""

from __future__ import annotations

import numpy as np

from slarm_graph.geometry import Floats

_SURE = 13.82
"""Chi-square quantile of 99.9 % for two degrees of freedom."""
_MATTERS = 0.1
"""Share of the mean error that the point must explain for advice: a table's second digit. At half
and double of it the same recordings of the benchmark get advice (they have 0 % or over 20 %)."""
_LEAST_M = 1e-3
"""Smaller errors are within the decimals of the relations files [m]."""
_ROUNDS = 30
"""Rounds of reweighting; with half and with four times as many fr-clinic's stays to 0.02 mm."""


def point_advice(estimated: Floats, true: Floats) -> str:
    """Return advice when the relations fit clearly better at another point of the robot.

    Parameters
    ----------
    estimated, true : (U, 3) float64
        Relative poses at the point where they were evaluated [m, m, rad].

    Returns
    -------
    str
        Advice with the point and the error there; empty where there is none.
    """
    moves, errors = _moves(estimated), estimated[:, :2] - true[:, :2]
    point, information = _fitted(moves, errors)
    before, after = _sizes(errors).mean(), _sizes(errors + moves @ point).mean()
    if point @ information @ point < _SURE or after > (1.0 - _MATTERS) * before:
        return ""
    x, y = (round(float(v), 3) + 0.0 for v in point)
    return (
        f"they fit better at a point ({x:.3f}, {y:.3f}) m from it, where it is {after:.4f}: is the"
        " mounting right, or are they about another part of the robot?"
    )


def _moves(relations: Floats) -> Floats:
    """Return the derivative (U, 2, 2) of a point's displacement by the point: R - 1."""
    cos, sin = np.cos(relations[:, 2]) - 1.0, np.sin(relations[:, 2])
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=1)


def _fitted(moves: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Return the point (2,) of the least sum of distances (Weiszfeld) and its information.

    The information (2, 2) is that of an M-estimator (Huber, "Robust Statistics", 1981, 6.3).
    """
    point, weights = np.zeros(2), np.ones(len(errors))
    for _ in range(_ROUNDS):
        curvature = np.einsum("u,uij,uik->jk", weights, moves, moves)
        slope = np.einsum("u,uij,ui->j", weights, moves, errors)
        point = -np.linalg.pinv(curvature) @ slope
        weights = 1.0 / np.maximum(_sizes(errors + moves @ point), _LEAST_M)
    curvature = np.einsum("u,uij,uik->jk", weights, moves, moves)
    pulls = np.einsum("u,uij,ui->uj", weights, moves, errors + moves @ point)
    return point, curvature @ np.linalg.pinv(pulls.T @ pulls) @ curvature


def _sizes(errors: Floats) -> Floats:
    return np.hypot(errors[:, 0], errors[:, 1])
