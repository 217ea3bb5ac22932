# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The closed exploration loop: sense, localise, map, plan and drive until nothing is left."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slarm_graph.backend import SlamBackend, SlamResult
from slarm_graph.config import ExploreConfig, MappingConfig
from slarm_graph.exploration.coverage_grid import CoverageGrid, driving_cell
from slarm_graph.exploration.drive_report import DriveReport, drive_report
from slarm_graph.exploration.explorer import Explorer, Finished, Leg
from slarm_graph.exploration.live_map import LiveMap
from slarm_graph.exploration.local_controller import LocalController
from slarm_graph.exploration.paths import path_between
from slarm_graph.exploration.searches import reachable
from slarm_graph.exploration.survey import Survey
from slarm_graph.geographic import Coverage
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.reading_log import ReadingLog
from slarm_graph.snapshots import State, restore_state, state_of
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import DriveCommand, World

_MAX_ASKS: Final = 50
"""Consecutive goals without a path before the drive ends: the explorer counts each as tried, so
that more never helped."""
_MOST_RETURNS: Final = 10
"""Returns to the start in a drive because the map is inconsistent: one that still is after so many
revisits of known places will be after the next."""
_APART: Final = ("_world", "_backend", "_explorer")
_AT_HOME_M: Final = 0.05
"""Distance to the start that counts as being there: a driving cell."""
_NO_LEG: Final = Leg(np.empty((0, 2)), more=False)
"""Placeholder without points where there is no leg."""


@dataclass(frozen=True, slots=True)
class Exploration:
    """Result of a closed loop.

    Parameters
    ----------
    slam : SlamResult
        As the backend gives it, in its own map frame.
    world_from_map : Pose2
        From the known start pose; nothing else is aligned.
    trajectory : Trajectory
        `world_from_robot` as estimated, one pose per reading.
    truth : Trajectory
        `world_from_robot` in truth, one pose per reading.
    log : ReadingLog
        Of all readings.
    geometry : GridGeometry
        Of the coverage.
    coverage : Coverage
        From the corrected trajectory.
    finished : Finished
        Why it ended.
    report : DriveReport
    """

    slam: SlamResult
    world_from_map: Pose2
    trajectory: Trajectory
    truth: Trajectory
    log: ReadingLog
    geometry: GridGeometry
    coverage: Coverage
    finished: Finished
    report: DriveReport


class ClosedLoop:
    """A robot that explores an unknown world, one reading at a time.

    Parameters
    ----------
    world : World
    backend : SlamBackend
        Fresh; it sees every reading.
    explorer : Explorer
        Fresh.
    config : ExploreConfig
    extent_m : (x_min, x_max, y_min, y_max)
        The rough boundary [m].
    start : Pose2
        `world_from_robot` at the beginning, known to the robot.
    mapping : MappingConfig, optional
        Of the map for driving.
    log : ReadingLog, optional
        Where the readings are kept.
    """

    def __init__(
        self,
        world: World,
        backend: SlamBackend,
        explorer: Explorer,
        config: ExploreConfig,
        *,
        extent_m: tuple[float, float, float, float],
        start: Pose2,
        mapping: MappingConfig | None = None,
        log: ReadingLog | None = None,
    ) -> None:
        self._world, self._explorer, self._backend = world, explorer, backend
        self._config, self._start = config, start
        self._survey = Survey(
            backend,
            config,
            mapping or MappingConfig(),
            extent_m=extent_m,
            start=start,
            log=ReadingLog() if log is None else log,
        )
        self._controller = LocalController(config.driving)
        self._follower = self._controller.follower
        self._leg = _NO_LEG
        self._leg_age_s = 0.0
        self._going_home = False
        self._is_squeezing = False
        self._is_relocating = False
        self._returns = 0
        self._commands: list[DriveCommand] = []
        self._planning_s = 0.0
        self.finished: Finished | None = None

    @property
    def survey(self) -> Survey:
        """Estimated poses and map so far."""
        return self._survey

    @property
    def live(self) -> LiveMap:
        """The map so far."""
        return self._survey.live

    @property
    def pose(self) -> Pose2:
        """Estimated pose, `world_from_robot`."""
        return self._survey.pose

    def step(self) -> bool:
        """Take one reading and drive until the next; False when exploration has ended."""
        reading = self._world.read()
        self._survey.take_in(reading, self._world.truth())
        self._decide()
        if self.finished is not None:
            return False
        dt_s = self._survey.dt_s or 0.1
        self._commands.append(self._controller.command(self.pose, reading.scan, dt_s))
        self._world.drive(self._commands[-1])
        return True

    def snapshot(self) -> dict[str, State]:
        """Return the state between two steps, to resume from with a fresh loop and world."""
        return {
            "backend": self._backend.snapshot(),
            "explorer": state_of(self._explorer),
            "loop": state_of(self),
        }

    def restore(self, states: Mapping[str, State]) -> None:
        """Continue from a snapshot: the world is driven there again by the same commands."""
        self._backend.restore(states["backend"])
        restore_state(states["explorer"], self._explorer)
        restore_state(states["loop"], self)
        for number in range(self._survey.steps):
            self._survey.log.append(self._world.read())
            if number < len(self._commands):
                self._world.drive(self._commands[number])

    def kept_state(self) -> dict[str, object]:
        """Exclude from a snapshot what has its own, or is driven again."""
        return {k: v for k, v in vars(self).items() if k not in _APART}

    def outcome(self) -> Exploration:
        """Return the result so far."""
        survey = self._survey
        slam, live, truth = survey.rebuild(), survey.live, survey.truth
        return Exploration(
            slam,
            survey.world_from_map,
            slam.trajectory.transformed(survey.world_from_map),
            truth,
            survey.log,
            live.geometry,
            Coverage(live.observed(), live.visited, live.footprint()),
            self.finished or Finished("interrupted"),
            drive_report(truth, live.geometry, self._world.collisions(), self._planning_s),
        )

    def _decide(self) -> None:
        """Plan a new leg where the present one ends, is blocked or is due for review."""
        limit_s = self._config.mission_time_s
        if limit_s is not None and self._survey.log.driven_s >= limit_s:
            self.finished = Finished("the mission time is over")
            return
        self._leg_age_s += self._survey.dt_s
        self._controller.watch(self.pose)
        if self._controller.has_given_up:
            self.finished = Finished("the robot does not get on")
        if self._controller.is_backing_off:
            return
        done = self._follower.done
        blocked = not done and not self.live.is_clear(self._controller.path_ahead(self.pose))
        if self._is_relocating or self._survey.is_torn:
            self._relocate(stands=done or blocked)
        elif done or blocked or self._leg_age_s >= self._leg.review_s:
            self._ask(self.pose, self.live.coverage(), go_on=False)
        elif self._leg.more and self._follower.remaining_m(self.pose) < self._braking_m():
            path = np.concatenate([[[self.pose.x, self.pose.y]], self._follower.points_m[1:]])
            heading = math.atan2(*(path[-1] - path[-2])[::-1])
            end = Pose2(path[-1, 0], path[-1, 1], heading)
            self._ask(end, self.live.coverage(path), go_on=True)

    def _relocate(self, *, stands: bool) -> None:
        """Return to the start, instead of exploring, until the map is consistent again.

        Places seen before let the backend relocalise the robot.
        """
        began, self._is_relocating = not self._is_relocating, True
        if stands and not began:
            self._survey.rebuild()
        self._is_relocating = self._survey.is_torn
        if not self._is_relocating:
            self._follower.stop()
        elif began or stands:
            self._returns += 1
            path = self._path_home(self.live.coverage())
            if path is None or self._returns > _MOST_RETURNS:
                self.finished = Finished("the map contradicts itself, and going back did not help")
                return
            self._leg = _NO_LEG
            self._follower.follow(path)

    def _path_home(self, coverage: CoverageGrid) -> Floats | None:
        """Path (K, 2) [m] to the start; None where there is none, or the robot is there."""
        home = np.array([self._start.x, self._start.y])
        here = np.array([self.pose.x, self.pose.y])
        if math.hypot(*(home - here)) <= _AT_HOME_M:
            return None
        return path_between(coverage.driving, here, home)

    def _ask(self, pose: Pose2, coverage: CoverageGrid, *, go_on: bool) -> None:
        # On a map without the gap, the explorer would take its goal beyond for unreachable.
        tight = self._squeeze(coverage, pose) if self._is_in_a_gap(coverage, pose) else None
        goal = tight or self._goal(coverage, pose)
        if isinstance(goal, Finished) and not go_on:
            tight = self._squeeze(coverage, pose)
            goal = tight or goal
        self._is_squeezing = tight is not None
        if isinstance(goal, Finished):
            self._leg = _NO_LEG
            if not go_on:
                self._finish(goal, coverage)
            return
        self._leg, self._leg_age_s = goal, 0.0
        if len(goal.points_m) < 2:
            self._leg = _NO_LEG
            if not go_on:
                self._follower.stop()
        elif go_on:
            self._follower.extend(goal.points_m)
        else:
            self._follower.follow(goal.points_m)

    def _is_in_a_gap(self, coverage: CoverageGrid, pose: Pose2) -> bool:
        """Whether the current path leads through a gap without the margin."""
        start = driving_cell(coverage.driving, pose.x, pose.y)
        if not self._is_squeezing or self._follower.done or start is None:
            return False
        end = coverage.driving.geometry.cell_of(self._follower.points_m[-1])
        return not bool(reachable(coverage.driving.moves, start)[tuple(end)])

    def _squeeze(self, coverage: CoverageGrid, pose: Pose2) -> Leg | None:
        """Plan a path through a gap that only fits the body without the margin, to a new region."""
        tight = self.live.coverage(tight=True)
        start = driving_cell(coverage.driving, pose.x, pose.y)
        if start is None or self._going_home:
            return None
        beyond = reachable(tight.driving.moves, start) & ~reachable(coverage.driving.moves, start)
        # A rim one cell or two wide all along the walls is no region of its own.
        rim = np.ones((5, 5), dtype=np.uint8)
        if not cv2.morphologyEx(beyond.astype(np.uint8), cv2.MORPH_OPEN, rim).any():
            return None
        goal = self._goal(tight, pose)
        return goal if isinstance(goal, Leg) and len(goal.points_m) > 1 else None

    def _goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Ask the explorer until a goal has a path."""
        if self._going_home:
            return Finished("everything is known, back at the start")
        for _ in range(_MAX_ASKS):
            began = time.thread_time()
            goal = self._explorer.next_goal(coverage, pose)
            self._planning_s += time.thread_time() - began
            if isinstance(goal, Finished) or len(goal.points_m) > 1:
                return goal
        return _NO_LEG

    def _finish(self, goal: Finished, coverage: CoverageGrid) -> None:
        """End here, or after planning on the corrected map, or back at the start."""
        self._follower.stop()
        if self._survey.is_stale and not self._going_home:
            self._survey.rebuild()
            self._ask(self.pose, self.live.coverage(), go_on=False)
            return
        if self._config.return_to_start and not self._going_home:
            path = self._path_home(coverage)
            if path is not None:
                self._going_home = True
                self._follower.follow(path)
                return
        self.finished = goal

    def _braking_m(self) -> float:
        speed, brakes = self._config.driving.speed_m_s, self._config.driving.acceleration_m_s2
        return speed * speed / (2.0 * brakes) + 2.0 * speed * self._survey.dt_s
