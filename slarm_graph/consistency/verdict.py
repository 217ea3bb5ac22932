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

from slarm_graph.consistency.evidence import RIGHT_SHARE
from slarm_graph.consistency.pairs import VisitPairs, cross_check
from slarm_graph.consistency.places import ConflictPlace, places
from slarm_graph.consistency.tears import Tear, tears
from slarm_graph.consistency.visits import Visits, build_visits
from slarm_graph.geometry import Floats
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

Verdict = Literal["consistent", "doubtful", "inconsistent"]

DOUBT_NAT = 5.0
"""Evidence of one pair of visits from which a map is doubtful [nat]. Recordings that held without
a pose off by 0.4 m stay below 4, pairs with one off by 0.5 m begin at 7."""

SURE_EXCESS = 0.03
"""Share of conflicts above the expected one from which a doubtful map is inconsistent: 0.005 where
a few walls are doubled, 0.03 to 0.2 where parts of the map lie wrong."""

TEAR_DOUBT_NAT, TEAR_SURE_NAT = 3.0, 6.0
"""Evidence against a step that odometry contradicts from which a trajectory is doubtful, and
inconsistent [nat]."""

LEAST_CHECKED = 0.25
"""Share of the way that has to be seen again; below, the verdict is doubtful at best."""

AWAY_M, AWAY_RATIO = 5.0, 2.0
"""Two visits check the map, not one stretch, when the way between them is longer than this [m] and
so many times the straight line: the robot has come back, instead of having looked ahead."""


@dataclass(frozen=True, slots=True)
class Contradictions:
    """How far a trajectory contradicts itself.

    Parameters
    ----------
    share : float
        Share of wall cells, of pairs of visits that saw them both, that one of the two looks
        through; nan where nothing was seen twice.
    expected_share, expected_sigma : float
        The same over pairs that do not speak of a wrong place (people, doors, glass, noise), and
        its standard deviation between samples as large as this.
    checked_share : float
        Share of the way whose walls were seen again when the robot had come back.
    compared : int
        Wall cells compared.
    places : tuple of ConflictPlace
        The strongest first.
    tears : tuple of Tear
        Steps at which odometry is right and the trajectory is not.
    points_m : (M, 2) float64
        Walls in conflict at the places, in the map [m].
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
    verdict: Verdict = "consistent"
    reasons: tuple[str, ...] = ()

    def notices(self) -> tuple[str, ...]:
        """Return what a user should be warned of."""
        return () if self.verdict == "consistent" else (f"the trajectory is {self.summary()}",)

    def summary(self) -> str:
        """Say the verdict in one line."""
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
) -> Contradictions:
    """Judge a trajectory by its scans, and by odometry where there is one.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
        `map_from_robot` at each scan.
    odometry : (N, 3) float64, optional
        `odom_from_robot` at each scan [m, m, rad]; nan where there was none.
    visits : Visits, optional
        Of these scans, where they are at hand.
    """
    if len(scans) != len(trajectory):
        raise ValueError(f"{len(scans)} scans for {len(trajectory)} poses")
    visits = build_visits(scans, trajectory.poses) if visits is None else visits
    pairs = cross_check(visits)
    found, points = places(visits, pairs, trajectory.stamps_ns, DOUBT_NAT)
    parted = () if odometry is None else tears(scans, trajectory, odometry)
    torn = tuple(t for t in parted if t.evidence_nat >= TEAR_DOUBT_NAT)
    checked = checked_share(visits, pairs)
    expected, sigma = _expected(pairs)
    result = Contradictions(
        share=pairs.conflict_share(),
        expected_share=expected,
        expected_sigma=sigma,
        checked_share=checked,
        compared=int(pairs.confirmed.sum() + pairs.contradicted.sum()),
        places=found,
        tears=torn,
        points_m=points,
    )
    return _judged(result)


def checked_share(visits: Visits, pairs: VisitPairs) -> float:
    """Share of the way that was seen again when the robot had come back."""
    length = np.diff(visits.way_m, axis=1)[:, 0]
    if not length.sum() > 0.0:
        return 0.0
    first, second = pairs.visits.T
    between_m = visits.way_m[second, 0] - visits.way_m[first, 1]
    straight_m = np.hypot(*(visits.poses[second, :2] - visits.poses[first, :2]).T)
    back = (between_m > AWAY_M) & (between_m > AWAY_RATIO * straight_m)
    seen: NDArray[np.bool_] = np.zeros(len(visits), dtype=np.bool_)
    seen[pairs.visits[back].ravel()] = True
    return float(length[seen].sum() / length.sum())


def _expected(pairs: VisitPairs) -> tuple[float, float]:
    """Return the share of conflicts between visits in the right place, and its deviation."""
    right = pairs.only(pairs.evidence() < 0.0)
    compared = right.confirmed + right.contradicted
    if not compared.sum():
        return (RIGHT_SHARE if len(pairs.visits) else math.nan), math.nan
    share = float(right.contradicted.sum() / compared.sum())
    # VisitPairs, not cells, are what is drawn anew each time: the ratio estimator's deviation.
    spread = np.sqrt(((right.contradicted - share * compared) ** 2).sum())
    return share, float(spread / compared.sum())


def _judged(result: Contradictions) -> Contradictions:
    """Draw the verdict from everything else."""
    torn = [t.evidence_nat for t in result.tears]
    lies_wrong = bool(result.places) and result.share - result.expected_share >= SURE_EXCESS
    sure = lies_wrong or max(torn, default=0.0) >= TEAR_SURE_NAT
    reasons = _reasons(result)
    verdict: Verdict = "inconsistent" if sure else "doubtful" if reasons else "consistent"
    return replace(result, verdict=verdict, reasons=reasons)


def _reasons(result: Contradictions) -> tuple[str, ...]:
    """Say in words what speaks against a trajectory."""
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
    if result.checked_share < LEAST_CHECKED:
        reasons.append(
            f"only {result.checked_share:.0%} of the way was seen again, the rest is not judged"
        )
    return tuple(reasons)
