# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The verdict on a trajectory: consistent, doubtful or inconsistent, with reasons and places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.conflict_places import ConflictPlace, conflict_places
from slarm_graph.consistency.evidence import RIGHT_CONFLICT_RATE
from slarm_graph.consistency.pairs import VisitPairs, cross_check
from slarm_graph.consistency.tears import Tear, find_tears
from slarm_graph.consistency.visits import Visits, build_visits
from slarm_graph.geometry import Floats
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

Verdict = Literal["consistent", "doubtful", "inconsistent"]

DOUBTFUL_NAT = 5.0
"""Evidence of one pair of visits from which a map is doubtful [nat]. Recordings without a pose off
by 0.4 m stay below 4, pairs with one off by 0.5 m begin at 7."""

INCONSISTENT_EXCESS = 0.03
"""Excess of the share of conflicts over the expected one from which a doubtful map is inconsistent:
0.005 where a few walls are doubled, 0.03 to 0.2 where parts of the map are misplaced."""

TEAR_DOUBTFUL_NAT, TEAR_INCONSISTENT_NAT = 3.0, 6.0
"""Evidence of a tear from which a trajectory is doubtful, and inconsistent [nat]."""

MIN_CHECKED = 0.25
"""Share of the path that has to be seen again; below, the verdict is doubtful at best."""

LOST_M, LOST_SHARE = 0.5, 0.01
"""A trajectory counts as lost when more than this share of it is off by more than this [m], half a
door. One that is expected to be, by its own covariances, is doubtful."""

REVISIT_M, DETOUR_RATIO = 5.0, 2.0
"""Two visits check each other when the path between them is longer than this [m] and so many times
the straight line: the robot has come back, instead of having looked ahead."""


@dataclass(frozen=True, slots=True)
class Contradictions:
    """Consistency report of a trajectory.

    Parameters
    ----------
    share : float
        Share of the wall cells seen by two visits that one of them saw as free; nan where nothing
        was seen twice.
    expected_share, expected_sigma : float
        The same over pairs without evidence of a wrong pose (people, doors, glass, noise), and its
        standard error.
    checked_share : float
        Share of the path whose walls were seen again when the robot had come back.
    compared : int
        Wall cells compared.
    places : tuple of ConflictPlace
        The strongest first.
    tears : tuple of Tear
        Steps at which the scans confirm odometry against the trajectory.
    points_m : (M, 2) float64
        Walls in conflict at the places, in the map [m].
    unsure_share : float
        Share of the poses expected to be off by more than `LOST_M`, as seen from the first one; nan
        where their covariances are unknown.
    verdict : Verdict
    reasons : tuple of str
        Why, in words for people; empty when consistent.
    """

    share: float
    expected_share: float
    expected_sigma: float
    checked_share: float
    compared: int
    places: tuple[ConflictPlace, ...]
    tears: tuple[Tear, ...]
    points_m: Floats
    unsure_share: float = math.nan
    verdict: Verdict = "consistent"
    reasons: tuple[str, ...] = ()

    def notices(self) -> tuple[str, ...]:
        """Return the verdict as a warning, unless it is consistent."""
        return () if self.verdict == "consistent" else (f"the trajectory is {self.summary()}",)

    def summary(self) -> str:
        """Return the verdict in one line."""
        share = "nothing was seen twice"
        if self.compared:
            share = f"{self.share:.1%} of shared wall cells in conflict"
            share += f", {self.expected_share:.1%} expected"
        checked = f"{self.checked_share:.0%} of the way cross-checked"
        return f"{self.verdict} ({share}; {checked})" + "".join(
            f"; {reason}" for reason in self.reasons
        )


def contradictions(
    scans: Sequence[LaserScan],
    trajectory: Trajectory,
    odometry: Floats | None = None,
    visits: Visits | None = None,
    position_sds_m: Floats | None = None,
) -> Contradictions:
    """Check a trajectory for consistency with its scans, its odometry, and what it claims to be.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
        `map_from_robot` at each scan.
    odometry : (N, 3) float64, optional
        `odom_from_robot` at each scan [m, m, rad]; nan where there was none.
    visits : Visits, optional
        Of these scans, where they are at hand.
    position_sds_m : (N,) float64, optional
        Standard deviation of every position along an axis, as seen from the first pose [m].
    """
    if len(scans) != len(trajectory):
        raise ValueError(f"{len(scans)} scans for {len(trajectory)} poses")
    visits = build_visits(scans, trajectory.poses) if visits is None else visits
    pairs = cross_check(visits)
    places, points = conflict_places(visits, pairs, trajectory.stamps_ns, DOUBTFUL_NAT)
    candidates = () if odometry is None else find_tears(scans, trajectory, odometry)
    torn = tuple(t for t in candidates if t.evidence_nat >= TEAR_DOUBTFUL_NAT)
    checked = checked_share(visits, pairs)
    expected, sigma = _expected(pairs)
    result = Contradictions(
        share=pairs.conflict_share(),
        expected_share=expected,
        expected_sigma=sigma,
        checked_share=checked,
        compared=int(pairs.confirmed.sum() + pairs.contradicted.sum()),
        places=places,
        tears=torn,
        points_m=points,
        unsure_share=unsure_share(position_sds_m),
    )
    return _with_verdict(result)


def checked_share(visits: Visits, pairs: VisitPairs) -> float:
    """Share of the path that was seen again when the robot had come back."""
    length = np.diff(visits.path_m, axis=1)[:, 0]
    if not length.sum() > 0.0:
        return 0.0
    first, second = pairs.visits.T
    between_m = visits.path_m[second, 0] - visits.path_m[first, 1]
    straight_m = np.hypot(*(visits.poses[second, :2] - visits.poses[first, :2]).T)
    back = (between_m > REVISIT_M) & (between_m > DETOUR_RATIO * straight_m)
    seen: NDArray[np.bool_] = np.zeros(len(visits), dtype=np.bool_)
    seen[pairs.visits[back].ravel()] = True
    return float(length[seen].sum() / length.sum())


def unsure_share(position_sds_m: Floats | None) -> float:
    """Share of positions expected to be off by more than `LOST_M`; nan where nothing is known.

    With normal errors alike along both axes, distances have Rayleigh's distribution.

    Parameters
    ----------
    position_sds_m : (N,) float64 or None
        Standard deviations along an axis [m].
    """
    if position_sds_m is None or not len(position_sds_m):
        return math.nan
    # Below a millionth of it nothing is off so far, and a square would be no normal number.
    sigmas = LOST_M / np.maximum(position_sds_m, 1e-6 * LOST_M)
    return float(np.exp(-0.5 * sigmas**2).mean())


def _expected(pairs: VisitPairs) -> tuple[float, float]:
    """Return the share of conflicts between visits at right poses, and its standard error."""
    right = pairs.only(pairs.evidence() < 0.0)
    compared = right.confirmed + right.contradicted
    if not compared.sum():
        return (RIGHT_CONFLICT_RATE if len(pairs.visits) else math.nan), math.nan
    share = float(right.contradicted.sum() / compared.sum())
    # Pairs, not cells, are the independent sample: standard error of the ratio estimator.
    spread = np.sqrt(((right.contradicted - share * compared) ** 2).sum())
    return share, float(spread / compared.sum())


def _with_verdict(result: Contradictions) -> Contradictions:
    """Add the verdict and its reasons."""
    torn = [t.evidence_nat for t in result.tears]
    is_misplaced = (
        bool(result.places) and result.share - result.expected_share >= INCONSISTENT_EXCESS
    )
    is_inconsistent = is_misplaced or max(torn, default=0.0) >= TEAR_INCONSISTENT_NAT
    reasons = _reasons(result)
    verdict: Verdict = (
        "inconsistent" if is_inconsistent else "doubtful" if reasons else "consistent"
    )
    return replace(result, verdict=verdict, reasons=reasons)


def _reasons(result: Contradictions) -> tuple[str, ...]:
    """Describe the findings against a trajectory."""
    reasons = []
    if result.places:
        worst = result.places[0]
        x, y = worst.position_m
        seen = worst.contradicted + worst.confirmed
        reasons.append(
            f"visits contradict each other at {len(result.places)} place(s), most at"
            f" ({x:.1f}, {y:.1f}) m: {worst.contradicted} of {seen} wall cells looked through"
        )
    if result.tears:
        reasons.append(f"scans and odometry contradict {len(result.tears)} step(s)")
    if result.unsure_share > LOST_SHARE:
        reasons.append(
            f"{result.unsure_share:.0%} of the way is expected to be more than {LOST_M:g} m off, as"
            " seen from its start, by the covariances of its poses"
        )
    if result.checked_share < MIN_CHECKED:
        reasons.append(
            f"only {result.checked_share:.0%} of the way was seen again, the rest is not judged"
        )
    return tuple(reasons)
