# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors planted into good trajectories, of the kinds that SLAM makes, to try a verdict on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.geometry import Floats, between, compose

KINDS = ("wrong closure", "cut-out loop", "bent stretch", "tear")

FAR_M = 0.5
"""A relation off by more is lost, as in the robustness matrix [m]."""

LOST_SHARE = 0.01
"""Share of lost relations from which a run is lost, as there."""


@dataclass(frozen=True, slots=True)
class Planted:
    """A trajectory with an error in it.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    poses : (N, 3) float64
        `map_from_robot` [m, m, rad].
    first, last : int
        The scans between which it was made; everything later is moved by it as one.
    """

    kind: str
    poses: Floats
    first: int
    last: int


def plant(poses: Floats, kind: str, rng: np.random.Generator) -> Planted:
    """Plant an error at a random place.

    A wrong closure spreads 0.7 to 3 m and up to 10 degrees evenly over 20 to 80 m; a loop cut out
    drifts by 0.1 to 0.5 degrees and 0.5 to 3 cm per metre over as much; a stretch of 3 to 10 m is
    bent by 1 to 4 degrees per metre; a tear moves by 0.6 to 2 m and up to 20 degrees at once.

    Parameters
    ----------
    poses : (N, 3) float64
        A good trajectory [m, m, rad].
    kind : str
        One of `KINDS`.
    rng : numpy Generator
    """
    way_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))]
    length_m = _length_m(kind, way_m[-1], rng)
    start_m = rng.uniform(0.1 * way_m[-1], max(0.9 * way_m[-1] - length_m, 0.11 * way_m[-1]))
    first = int(np.searchsorted(way_m, start_m))
    last = max(int(np.searchsorted(way_m, start_m + length_m)), first + 1)
    last = min(last, len(poses) - 1)
    error = _error(kind, way_m[last] - way_m[first], rng)
    steps = between(poses[:-1], poses[1:])
    weights = np.diff(way_m[first : last + 1])
    weights = weights / weights.sum() if weights.sum() > 0 else np.full(last - first, 1.0)
    steps[first:last] = compose(weights[:, None] * error, steps[first:last])
    return Planted(kind, _chained(poses[0], steps), first, last)


def _length_m(kind: str, way_m: float, rng: np.random.Generator) -> float:
    """Draw over which length of way the error is spread [m]."""
    if kind == "tear":
        return 0.0
    low, high = (3.0, 10.0) if kind == "bent stretch" else (20.0, 80.0)
    return float(min(rng.uniform(low, high), 0.5 * way_m))


def _error(kind: str, length_m: float, rng: np.random.Generator) -> Floats:
    """Draw the whole error (3,) [m, m, rad] over a length of way [m]."""
    sign = rng.choice([-1.0, 1.0])
    direction = rng.uniform(-np.pi, np.pi)
    along = np.array([np.cos(direction), np.sin(direction)])
    if kind == "tear":
        return np.r_[rng.uniform(0.6, 2.0) * along, sign * np.radians(rng.uniform(0, 20))]
    if kind == "bent stretch":
        return np.array([0.0, 0.0, sign * np.radians(rng.uniform(1, 4)) * length_m])
    if kind == "wrong closure":
        return np.r_[rng.uniform(0.7, 3.0) * along, sign * np.radians(rng.uniform(0, 10))]
    turn = sign * np.radians(rng.uniform(0.1, 0.5)) * length_m
    return np.array([rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.03) * length_m, 0.0, turn])


def _chained(first: Floats, steps: Floats) -> Floats:
    """Chain steps (N - 1, 3) up to poses (N, 3)."""
    poses = np.empty((len(steps) + 1, 3))
    poses[0] = first
    for k, step in enumerate(steps):
        poses[k + 1] = compose(poses[k], step)
    return poses


def is_lost(good: Floats, poses: Floats) -> bool:
    """Tell whether a trajectory is lost, by relations made of a good one.

    Every scan is related to the one a metre of way on, and to one of an earlier visit within 3 m
    where there is one, as the relations of the Freiburg benchmark are.
    """
    a, b = _relations(good)
    off = between(good[a], good[b])[:, :2] - between(poses[a], poses[b])[:, :2]
    return bool((np.hypot(*off.T) > FAR_M).mean() > LOST_SHARE)


def _relations(good: Floats) -> tuple[np.ndarray, np.ndarray]:
    from scipy.spatial import cKDTree

    way_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(good[:, :2], axis=0).T))]
    nodes = np.unique(np.searchsorted(way_m, np.arange(0.0, way_m[-1], 0.5)))
    pairs = cKDTree(good[nodes, :2]).query_pairs(3.0, output_type="ndarray")
    a, b = nodes[pairs[:, 0]], nodes[pairs[:, 1]]
    far = np.abs(way_m[b] - way_m[a]) > 15.0
    chain = np.searchsorted(way_m, way_m[nodes] + 1.0)
    inside = chain < len(good)
    rng = np.random.default_rng(0)
    some = rng.permutation(np.flatnonzero(far))[: len(nodes)]
    return np.r_[nodes[inside], a[some]], np.r_[chain[inside], b[some]]
