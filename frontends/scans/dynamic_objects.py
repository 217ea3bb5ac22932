# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Dynamic objects: what fits another pose candidate because small objects have moved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.likelihood_grid import Lattice, likelihoods
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.pose_candidates import PoseCandidate
from slarm_graph.frontends.scans.scan_fit import UNKNOWN_FIT, is_observed
from slarm_graph.frontends.scans.small_objects import (
    DYNAMIC_SHARE,
    DYNAMIC_STEP_M,
    count_small_objects,
    is_wide,
)
from slarm_graph.frontends.scans.small_pose import BASIN_COVARIANCE
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_LOG_ANOTHER = math.log(DYNAMIC_SHARE) + 2.0 * math.log(
    math.sqrt(float(BASIN_COVARIANCE[0, 0])) / DYNAMIC_STEP_M
)
"""Log probability that one more object moves, and by the apparent displacement, too."""


def with_dynamic_objects(
    candidates: Sequence[Sequence[PoseCandidate]],
    points: Floats,
    local_map: LocalMap,
    mean_fit: float,
    known: Sequence[tuple[float, int]],
) -> list[list[PoseCandidate]]:
    """Let every candidate explain by moved objects what fits better at another candidate.

    Where only small objects fit there and not here, the scan is as likely here as there, times the
    probability that all of them have moved. What is wider than a person is static; and a vague
    candidate is contradicted by nothing.

    Parameters
    ----------
    candidates : sequence of sequences of PoseCandidate
        Of every hypothesis, with posteriors.
    points : (K, 2) float64
        The scan, in the robot's frame [m].
    local_map : LocalMap
    mean_fit : float
        Mean fit of true matches.
    known : sequence of tuple of float, int
        Probability that small objects move as they did one scan before, and their number, by every
        hypothesis.

    Returns
    -------
    list of lists of PoseCandidate
        As given, the likeliest first.
    """
    if local_map.grid is None or sum(map(len, candidates)) < 2:
        return [list(own) for own in candidates]
    view = local_map.grid.lattice, local_map.observed, local_map.observed_step, points
    others = [p for own in candidates for p in own if p.inliers]
    explained = []
    for own, before in zip(candidates, known, strict=True):
        updated = [
            p if p.is_vague else _explained(p, others, view, UNKNOWN_FIT * mean_fit, before)
            for p in own
        ]
        explained.append(sorted(updated, key=lambda p: -p.log_posterior))
    return explained


def _explained(
    candidate: PoseCandidate,
    others: Sequence[PoseCandidate],
    view: tuple[Lattice, NDArray[np.bool_], int, Floats],
    min_gain: float,
    known: tuple[float, int],
) -> PoseCandidate:
    """Add to a candidate's evidence that of another one, discounted for moved objects."""
    best, count = -math.inf, 0
    for other in others:
        if _log_probability(1, known) + other.evidence <= max(candidate.evidence, best):
            continue
        objects = _moved_objects(*view, candidate.pose, other.pose, min_gain)
        evidence = _log_probability(objects, known) + other.evidence if objects else -math.inf
        if evidence > best:
            best, count = evidence, objects
    total = float(np.logaddexp(candidate.evidence, best))
    return replace(
        candidate,
        log_posterior=candidate.log_posterior + total - candidate.evidence,
        evidence=total,
        dynamic_objects=(math.exp(best - total), count),
    )


def _log_probability(objects: int, known: tuple[float, int]) -> float:
    """Log probability that so many objects move by the same displacement."""
    independent = math.log(DYNAMIC_SHARE) + (objects - 1) * _LOG_ANOTHER
    probability, known_count = known
    if probability <= 0.0:
        return independent
    return max(independent, math.log(probability) + max(objects - known_count, 0) * _LOG_ANOTHER)


@kernel
def _moved_objects(
    lattice: Lattice,
    observed: NDArray[np.bool_],
    observed_step: int,
    points: Floats,
    here: Floats,
    there: Floats,
    min_gain: float,
) -> int:
    """Count the small objects that fit better by `min_gain` from there (3,) than from here (3,).

    0 where something wider does, or nothing. A wall may go on in unknown space.
    """
    gains = likelihoods(lattice, points, there) - likelihoods(lattice, points, here)
    is_certain = ~is_wide(points)
    c, s = math.cos(here[2]), math.sin(here[2])
    for i in range(len(points)):
        x = here[0] + c * points[i, 0] - s * points[i, 1]
        y = here[1] + s * points[i, 0] + c * points[i, 1]
        is_certain[i] = is_certain[i] or is_observed(lattice, observed, observed_step, x, y)
    return count_small_objects(points, gains > min_gain, is_certain)
