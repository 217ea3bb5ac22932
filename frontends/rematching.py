# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Matching every keyframe again, against all that was ever seen around it.

Once the graph has found roughly where everything is, each keyframe is compared with the keyframes
near it from every visit, before and after. What comes out are relative poses between neighbours,
much denser and more even than lidar odometry and a few loop closures.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slarm_graph.config import MatchingConfig
from slarm_graph.frontends.gauss_newton import refine
from slarm_graph.frontends.submaps import likelihood_of
from slarm_graph.geometry import Floats, between, compose, invert

_POINT_INFORMATION = 0.3
_PRIOR_INFORMATION = np.diag([1 / 0.3**2, 1 / 0.3**2, 1 / 0.1**2])


@dataclass(frozen=True, slots=True)
class Job:
    """Keyframes to match against one group of keyframes.

    Parameters
    ----------
    members : (M,) int64
        Keyframes the target is made of.
    sources : (S,) int64
        Keyframes to match against it; none is a member.
    references : (S,) int64
        The member nearest to each source, which the outcome is told relative to.
    """

    members: NDArray[np.int64]
    sources: NDArray[np.int64]
    references: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Rematch:
    """Relative poses between keyframes.

    Parameters
    ----------
    i, j : (R,) int64
        Reference and source keyframe.
    i_from_j : (R, 3) float64
    information : (R, 3, 3) float64
        In the body frame of j.
    score : (R,) float64
    moved : (R, 3) float64
        From where j was believed to where it was found, in its own frame.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    i_from_j: Floats
    information: Floats
    score: Floats
    moved: Floats


def plan(poses: Floats, *, stride: int, length: int, radius_m: float, visits: int) -> list[Job]:
    """Choose for every keyframe the groups to match it against.

    Groups are runs of `length` keyframes, a new one every `stride`. A keyframe meets the nearest
    group of each visit (runs of time near the place), at most `visits` of them, and in its own
    visit the groups just before and just after it.
    """
    count = len(poses)
    tree = cKDTree(poses[:, :2])
    starts = np.arange(0, max(count - length // 2, 1), stride)
    sources: dict[int, list[tuple[int, int]]] = {int(s): [] for s in starts}
    for k, near in enumerate(tree.query_ball_point(poses[:, :2], radius_m, return_sorted=True)):
        for start, reference in _groups_for(k, np.array(near), poses, starts, length, visits):
            sources[start].append((k, reference))
    jobs = []
    for start, pairs in sources.items():
        if pairs:
            members = np.arange(start, min(start + length, count))
            jobs.append(
                Job(members, np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs]))
            )
    return jobs


def _groups_for(
    k: int,
    near: NDArray[np.int64],
    poses: Floats,
    starts: NDArray[np.int64],
    length: int,
    visits: int,
) -> list[tuple[int, int]]:
    """Return (start of group, reference keyframe) for one keyframe."""
    stride = int(starts[1] - starts[0]) if len(starts) > 1 else length
    near = near[near != k]
    if not len(near):
        return []
    runs = np.split(near, np.flatnonzero(np.diff(near) > length) + 1)
    distance = np.hypot(*(poses[near, :2] - poses[k, :2]).T)
    lookup = dict(zip(near.tolist(), distance.tolist(), strict=True))
    chosen: list[tuple[float, int, int]] = []
    for run in runs:
        sides = (
            (run[run < k], run[run > k]) if run[0] < k + length and run[-1] > k - length else (run,)
        )
        for side in sides:
            if len(side):
                reference = min(side.tolist(), key=lambda m: (lookup[m], m))
                start = _centered(reference, k, starts, stride, length)
                if start is not None:
                    chosen.append((lookup[reference], start, reference))
    chosen.sort()
    return [(start, reference) for _, start, reference in chosen[:visits]]


def _centered(
    reference: int, k: int, starts: NDArray[np.int64], stride: int, length: int
) -> int | None:
    """Return the group that holds the reference nearest its middle and does not hold k."""
    best, best_off = None, float("inf")
    for start in range(max(0, (reference - length) // stride * stride), reference + 1, stride):
        if start > starts[-1] or not start <= reference < start + length:
            continue
        if start <= k < start + length:
            continue
        off = abs(start + length / 2 - reference)
        if off < best_off:
            best, best_off = start, off
    return best


def rematch(
    points: Sequence[Floats],
    poses: Floats,
    jobs: Sequence[Job],
    matching: MatchingConfig,
    *,
    threads: int = 2,
) -> Rematch:
    """Match all jobs' keyframes; the outcome does not depend on the number of threads."""

    def run(job: Job) -> tuple[Floats, Floats, Floats]:
        return _run(job, points, poses, matching)

    with ThreadPoolExecutor(threads) as pool:
        outcomes = list(pool.map(run, jobs))
    i = np.concatenate([job.references for job in jobs])
    j = np.concatenate([job.sources for job in jobs])
    found = np.concatenate([o[0] for o in outcomes])
    expected = between(poses[i], poses[j])
    return Rematch(
        i,
        j,
        found,
        np.concatenate([o[1] for o in outcomes]),
        np.concatenate([o[2] for o in outcomes]),
        between(expected, found),
    )


def _run(
    job: Job, points: Sequence[Floats], poses: Floats, matching: MatchingConfig
) -> tuple[Floats, Floats, Floats]:
    # Coordinates relative to the group keep the grid's rounding the same wherever it lies.
    base = poses[job.members[0]]
    grid = likelihood_of(
        [points[m] for m in job.members], between(base, poses[job.members]), matching
    )
    sources = [points[s] for s in job.sources]
    starts = between(base, poses[job.sources])
    found, information, score = _refine_many(
        grid.values,
        grid.origin_x_m,
        grid.origin_y_m,
        grid.resolution_m,
        np.concatenate(sources),
        np.cumsum([0, *(len(s) for s in sources)]),
        starts,
        _PRIOR_INFORMATION,
        _POINT_INFORMATION,
        matching.max_iterations,
    )
    references = between(base, poses[job.references])
    return compose(invert(references), found), information, score


@njit(cache=True, nogil=True)
def _refine_many(
    values: NDArray[np.float32],
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: Floats,
    offsets: NDArray[np.int64],
    starts: Floats,
    prior_information: Floats,
    point_information: float,
    max_iterations: int,
) -> tuple[Floats, Floats, Floats]:
    """Refine several scans on one grid; return poses (S, 3), informations (S, 3, 3), scores."""
    count = len(starts)
    poses = np.empty((count, 3))
    information = np.empty((count, 3, 3))
    scores = np.empty(count)
    for k in range(count):
        part = points[offsets[k] : offsets[k + 1]]
        pose, data, score, _, _ = refine(
            values,
            origin_x,
            origin_y,
            resolution,
            part,
            starts[k],
            starts[k],
            prior_information,
            point_information,
            max_iterations,
        )
        poses[k] = pose
        information[k] = data
        scores[k] = score
    return poses, information, scores
