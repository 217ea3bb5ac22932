# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Agreement of runs of one recording, between seeds and backends; needs no ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import align
from slarm_graph.eval.association import associate
from slarm_graph.eval.map_accuracy import map_accuracy
from slarm_graph.eval.trajectory_accuracy import aligned_rmse_m
from slarm_graph.geometry import Pose2
from slarm_graph.grid import OccupancyGrid
from slarm_graph.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Estimate:
    """The trajectory and map of a run.

    Parameters
    ----------
    trajectory : Trajectory
    grid : OccupancyGrid, optional
        None where there is only a trajectory.
    truth : Trajectory, optional
        True path of this run's robot: exploring robots drive another path in every run.
    map_from_grid : Pose2
        Pose of the grid in the frame of the trajectories [m, m, rad], for another system's frame.
    """

    trajectory: Trajectory
    grid: OccupancyGrid | None = None
    truth: Trajectory | None = None
    map_from_grid: Pose2 = field(default_factory=Pose2)


def aligned_to(ours: Estimate, theirs: Estimate) -> Estimate:
    """Return another system's result aligned to ours by the trajectories.

    It is returned unchanged when the two have no time in common.
    """
    try:
        motion = align(associate(ours.trajectory, theirs.trajectory)).reference_from_estimate
    except BadInput:
        return theirs
    path = theirs.trajectory.transformed(motion)
    return replace(theirs, trajectory=path, truth=ours.truth, map_from_grid=motion)


def is_same_drive(a: Estimate, b: Estimate) -> bool:
    """Whether two runs are of the same drive, so that their poses can be compared."""
    if a.truth is None or b.truth is None:
        return True
    return np.array_equal(a.truth.poses, b.truth.poses)


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of runs of one source: means over their pairs.

    Parameters
    ----------
    source, between : str
        `between` says what is compared: the seeds of one variant, or two variants.
    runs : int
    end_spread_m : float
        Distance between the last positions [m]; NaN where the robots drove different paths.
    path_rms_m : float
        Root mean square distance of the aligned paths [m]; NaN likewise.
    walls_iou, free_iou : float
        Intersection over union of the maps' occupied and free cells.
    """

    source: str
    between: str
    runs: int
    end_spread_m: float
    path_rms_m: float
    walls_iou: float
    free_iou: float


def agreement(source: str, between: str, estimates: Sequence[Estimate]) -> Agreement | None:
    """Compare every pair of runs of one source; None where there is no pair."""
    found = [_pair(a, b) for a, b in combinations(estimates, 2)]
    if not found:
        return None
    known = np.ma.masked_invalid(np.array(found)).mean(axis=0).filled(np.nan)
    return Agreement(source, between, len(estimates), *map(float, known))


def _pair(a: Estimate, b: Estimate) -> tuple[float, float, float, float]:
    ends_m = path_m = walls = free = np.nan
    try:
        if is_same_drive(a, b):
            ends_m = float(np.linalg.norm(a.trajectory.poses[-1, :2] - b.trajectory.poses[-1, :2]))
            pairs = associate(a.trajectory, b.trajectory)
            path_m = aligned_rmse_m(pairs)
        if a.grid is not None and b.grid is not None:
            motion = a.map_from_grid.inverse() @ b.map_from_grid
            maps = map_accuracy(a.grid, b.grid, reference_from_estimate=motion)
            walls, free = maps.iou, maps.iou_free
    except BadInput:
        pass
    return ends_m, path_m, walls, free


def agreements(
    estimates: Mapping[tuple[str, str, int], Estimate],
) -> list[Agreement]:
    """Compare the seeds of every variant, and the variants at their first common seed.

    Parameters
    ----------
    estimates : mapping of (source, variant, seed) to Estimate
    """
    found: list[Agreement | None] = []
    for source in dict.fromkeys(key[0] for key in estimates):
        variants = dict.fromkeys(key[1] for key in estimates if key[0] == source)
        by_seed = {
            v: {k[2]: e for k, e in estimates.items() if k[:2] == (source, v)} for v in variants
        }
        found += [agreement(source, f"seeds of {v}", list(by_seed[v].values())) for v in variants]
        for a, b in combinations(variants, 2):
            common = sorted(by_seed[a].keys() & by_seed[b].keys())
            if common:
                both = [by_seed[a][common[0]], by_seed[b][common[0]]]
                found.append(agreement(source, f"{a} and {b}", both))
    return [one for one in found if one is not None]
