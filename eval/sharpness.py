# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Sharpness of a map, without ground truth: spread of its points by doubled or blurred walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slarm_graph.eval.metrics import Metric
from slarm_graph.geometry import Floats
from slarm_graph.mapping import thinned
from slarm_graph.recovery.returns import cell_keys

_MIN_NEIGHBOURS = 8
"""Fewest points of a neighbourhood: a covariance of the plane has three parameters; of fewer than
about twice as many points it is noise."""
_LONGER_THAN_WIDE = 2.0
"""Least ratio of length to width of a wall's neighbourhood: at 2 the spread across is the wall's;
corners and clutter are excluded."""
_MAX_POINTS = 250_000
"""Neighbourhoods are counted in a tree of so many points; their spread is that of some thousand
samples, which has the same expectation however many points are left out evenly."""


@dataclass(frozen=True, slots=True)
class Sharpness:
    """Sharpness of a map's end points; smaller is sharper.

    Parameters
    ----------
    entropy : float
        Mean map entropy [nat], the mean over points of 0.5 ln |2 pi e C| with C the covariance of
        the neighbourhood (Droeschel and Behnke 2018).
    wall_sigma_m : float
        Median standard deviation of the points across walls [m].
    wall_sigma_95_m : float
        95th percentile of the same [m], where doubled walls show first.
    samples : int
        Number of neighbourhoods evaluated.
    """

    entropy: float
    wall_sigma_m: float
    wall_sigma_95_m: float
    samples: int


def sharpness(
    points_m: Floats, *, radius_m: float = 0.3, samples: int = 4000, seed: int = 0
) -> Sharpness:
    """Measure the sharpness of a map's walls.

    Parameters
    ----------
    points_m : (N, 2) float64
        End points of all scans in the map [m].
    radius_m : float
        Radius of a neighbourhood [m]; walls doubled by less than this appear blurred.
    samples : int
        Number of neighbourhoods to evaluate, drawn evenly over the mapped area.
    seed : int
    """
    if not len(points_m):
        return Sharpness(float("nan"), float("nan"), float("nan"), 0)
    points_m = thinned(points_m, _MAX_POINTS)
    tree = cKDTree(points_m)
    covariances = [
        np.cov(points_m[near], rowvar=False)
        for near in tree.query_ball_point(_spread(points_m, samples, seed), radius_m)
        if len(near) >= _MIN_NEIGHBOURS
    ]
    if not covariances:
        return Sharpness(float("nan"), float("nan"), float("nan"), 0)
    eigenvalues = np.linalg.eigvalsh(np.stack(covariances)).clip(1e-12)
    entropy = 0.5 * np.log((2.0 * np.pi * math.e) ** 2 * eigenvalues.prod(axis=1))
    across, along = np.sqrt(eigenvalues).T
    walls = across[along > _LONGER_THAN_WIDE * across]
    sigma, sigma_95 = np.percentile(walls, [50, 95]) if len(walls) else (np.nan, np.nan)
    return Sharpness(float(entropy.mean()), float(sigma), float(sigma_95), len(covariances))


def _spread(points_m: Floats, count: int, seed: int) -> Floats:
    """Pick points at random, at most one per 5 cm cell, so that often-seen places count alike."""
    _, first = np.unique(cell_keys(points_m, 0.05), return_index=True)
    rng = np.random.default_rng(seed)
    picked: Floats = points_m[rng.permutation(first)[:count]]
    return picked


def sharpness_metrics(result: Sharpness) -> tuple[Metric, ...]:
    """Return the sharpness as metrics."""
    note = f"over {result.samples} neighbourhoods of the scans' end points"
    return (
        Metric("map_entropy_nat", result.entropy, note=note),
        Metric("wall_sigma_m", result.wall_sigma_m, note=note),
        Metric("wall_sigma_95_m", result.wall_sigma_95_m, note=note),
    )
