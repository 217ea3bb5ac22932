# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Stories of where the robot went: one as a rule, several while a scan leaves it open.

A story is a chain of places with what its odometry and velocity have come to. Each scan grows every
story by the places it may have there; what is the same place becomes one story again, what has
become improbable ends. So a slip or a jump is believed when the scans after it agree with it, and
a crowd before the laser is not, since what it pretends contradicts itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slarm_graph.frontends.scans.odometry_filter import OdometryFilter, Prediction, spread_about
from slarm_graph.frontends.scans.places import Outlook, Place, are_same, best_story, step_to
from slarm_graph.frontends.scans.reliability import RECOVERS
from slarm_graph.frontends.scans.small_pose import between3, carried3
from slarm_graph.geometry import Floats, Pose2

_HOPELESS = 30.0
"""Log odds at which a story ends: more than the one scan of a slip or a jump costs."""
_DECIDED = math.log(100.0)
"""Log odds at which the best story is the right one but for one in a hundred."""
_MOST = 4
"""Stories kept: two places after each of two doubtful scans."""


@dataclass(slots=True)
class Story:
    """One account of where the robot went.

    Parameters
    ----------
    motion : OdometryFilter
        Velocity, odometry's errors and whether it holds, by this account.
    pose : (3,) float64
        Last pose in the local map [m, m, rad].
    covariance : (3, 3) float64
        Of it, in the body frame, by the likeliest of what may have moved the robot.
    spread : (3, 3) float64
        Of it by all of that: while nothing is matched, odometry may have failed unseen.
    log_weight : float
        Of this account, up to a constant that all share.
    place : Place or None
        Where the last scan fitted; None where it was not matched.
    raw : (3,) float64 or None
        Pose by the last match alone.
    walkers : tuple of float, int
        Probability that small things walk as they did in the last scan, and how many they are.
    trail : list of (3,) float64
        Poses since the stories parted, the last one included.
    """

    motion: OdometryFilter = field(default_factory=OdometryFilter)
    pose: Floats = field(default_factory=lambda: np.zeros(3))
    covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    spread: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    log_weight: float = 0.0
    place: Place | None = None
    raw: Floats | None = None
    walkers: tuple[float, int] = (0.0, 0)
    trail: list[Floats] = field(default_factory=list)

    def outlook(self, span_s: float, odom_from_robot: Pose2 | None, lag_s: float) -> Outlook:
        """What this account expects next: motions from a pose that is not quite sure itself."""
        predictions = []
        for told in self.motion.predict(span_s, odom_from_robot, lag_s):
            covariance = told.covariance + carried3(self.covariance, told.motion)
            predictions.append(
                Prediction(told.motion, covariance, told.probability, told.unlearned)
            )
        excess = self.motion.wheels.noise.match_excess
        return Outlook(self.pose, tuple(predictions), excess, walkers=self.walkers)

    def branched(self) -> Story:
        """Return an account of its own that is the same so far."""
        return replace(self, motion=self.motion.branched(), trail=list(self.trail))

    def went(self, place: Place, outlook: Outlook, span_s: float) -> None:
        """Go on to a place, and learn from it."""
        is_match = place.inliers > 0
        if is_match:
            step = step_to(place, outlook, self.covariance)
            self.pose, self.covariance = step.pose, step.covariance
            self.spread = self.covariance
            self.motion.judge(step.found, step.found_covariance)
            if self.raw is not None:
                self.motion.learn(between3(self.raw, place.pose), step.claimed)
            self.motion.correct(span_s, step.moved, step.moved_covariance)
        else:
            told, wider = between3(self.pose, place.pose), self.spread - self.covariance
            self.pose, self.covariance = place.pose, best_story(place, outlook).covariance
            self.spread = spread_about(told, outlook.predictions) + carried3(wider, told)
            self.motion.wheels.interrupt()
            self.motion.coast()
        probability, things = place.walked
        self.walkers = (1.0 - RECOVERS) * probability, things
        self.place = place if is_match else None
        self.raw = place.pose if is_match else None
        self.log_weight += place.log_posterior
        self.trail.append(self.pose)


def grown(story: Story, places: Sequence[Place], outlook: Outlook, span_s: float) -> list[Story]:
    """Continue a story to each of the places worth it."""
    best = places[0].log_posterior
    worth = [p for p in places[:_MOST] if p.log_posterior > best - _HOPELESS]
    branches = [story, *(story.branched() for _ in worth[1:])]
    for branch, place in zip(branches, worth, strict=True):
        branch.went(place, outlook, span_s)
    return branches


def pruned(stories: Sequence[Story]) -> list[Story]:
    """Keep what is different and probable, the likeliest first; its weight becomes 0."""
    ranked = sorted(stories, key=lambda s: -s.log_weight)
    best = ranked[0].log_weight
    kept: list[Story] = []
    for story in ranked:
        if story.log_weight > best - _HOPELESS and not any(
            are_same(story.pose, k.pose) for k in kept
        ):
            story.log_weight -= best
            kept.append(story)
    return kept[:_MOST]


def is_decided(stories: Sequence[Story]) -> bool:
    """Whether the first story is beyond doubt."""
    return len(stories) == 1 or stories[1].log_weight < -_DECIDED
