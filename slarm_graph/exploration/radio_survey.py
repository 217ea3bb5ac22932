# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Informative path planning for the measured radio map: variance reduction per second of driving.

Unknown space counts as floor without readings: going there informs about the radio map and about
the place itself. Goals are rated by the readings along the whole path to them, and by its time.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from slarm_graph.config import DrivingConfig, Stage
from slarm_graph.exploration.coverage_grid import BLOCKED, CoverageGrid, start_cell
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.paths import anchors_m, path_between, without_collinear_points
from slarm_graph.exploration.searches import new_labels, reachable, walk_back, wavefront
from slarm_graph.geometry import Floats, Pose2, wrap_angle
from slarm_graph.grid import Mask
from slarm_graph.radio.measured.field_variance import FieldVariance, Shadowing
from slarm_graph.radio.measured.nodes import Nodes, make_nodes

_MOST_NODES: Final = 6_000
"""Nodes of the floor: planning takes some tenths of a second on so many."""
_GOALS: Final = 40
"""Candidate goals; half as many miss a good one now and then, more only take time."""
_APART_M: Final = 1.0
"""Distance between candidates: below any range of shadowing."""
_START_S: Final = 1.5
"""Added to a path's time, to brake, plan and accelerate; without it goals are the nearest steps."""
_REVIEW_S: Final = 4.0
"""Time after which a goal is replanned: 2.4 m of driving."""
_MAX_ASKS: Final = 8
"""A place that was the goal so many times is given up: half a minute of trying to get there."""
_PLACE_M: Final = 0.5
"""Goals in one square of this side are one place: about the robot's width and a half."""
_ANY_CELL: Final = 255
"""No code of the coverage grid, so that a search ends nowhere."""


class RadioSurveyConfig(Stage):
    """The explorer `radio-survey`."""

    certainty_db: float = Field(default=2.0, gt=0)
    """Standard deviation of the map, as root mean square over the floor, at which the survey ends;
    more than `model_sd_db`, which no drive can reduce."""
    range_m: float = Field(default=3.0, gt=0)
    """Distance at which the correlation of shadow fading is 0.14 (TR 38.901, Table 7.5-6: some
    metres indoors)."""
    field_sd_db: float = Field(default=4.0, gt=0)
    """Standard deviation of shadow fading (TR 38.901, Table 7.5-6: 3 to 8 dB indoors)."""
    noise_sd_db: float = Field(default=3.0, gt=0)
    """Standard deviation of a single reading: small-scale fading, partly averaged."""
    model_sd_db: float = Field(default=1.0, ge=0)
    """Error of the map besides shadow fading: terms of the propagation model, walls a cell off. On
    drives in the worlds paper_room and dead_ends it was 0.2 to 1.5 dB, median 1.0."""
    readings_per_s: float = Field(default=5.0, gt=0)
    """Rate of readings expected on the legs to come."""
    node_side_m: float = Field(default=0.5, gt=0)
    """Side of the squares of floor that are planned on; well below `range_m`."""

    @model_validator(mode="after")
    def _can_be_reached(self) -> Self:
        if self.certainty_db <= self.model_sd_db:
            raise ValueError(
                f"certainty_db = {self.certainty_db} is never reached, the model alone is off by"
                f" model_sd_db = {self.model_sd_db}; raise the one or lower the other"
            )
        return self


class RadioSurvey:
    """Drive where the measured radio map's variance falls most per second of driving."""

    settings: ClassVar[type[Stage]] = RadioSurveyConfig

    def __init__(self, settings: RadioSurveyConfig, driving: DrivingConfig) -> None:
        self._settings, self._driving = settings, driving
        self._asks: Counter[tuple[int, int]] = Counter()

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Drive to the best goal, until the map's standard deviation is as low as wished."""
        start = start_cell(coverage, pose)
        if start is None:
            return Finished("no free cell near the robot")
        if not len(coverage.heard_m):
            return Finished("nothing is listened to: there is no signal strength in the readings")
        floor = (coverage.codes != BLOCKED) & reachable(coverage.moves, start)
        s = self._settings
        nodes = make_nodes(coverage.geometry, floor, s.node_side_m, _MOST_NODES)
        shadowing = Shadowing(s.range_m, s.field_sd_db, s.noise_sd_db)
        variance = FieldVariance(nodes, coverage.heard_m, shadowing)
        candidates = self._worth_trying(nodes)
        left_db = math.hypot(variance.rms_db(candidates), s.model_sd_db)
        if left_db <= s.certainty_db:
            return Finished(f"the radio map is sure to {left_db:.2f} dB")
        leg = self._best_leg(coverage, variance, candidates, start, pose)
        return leg or Finished(f"no way tells more; the radio map is sure to {left_db:.2f} dB")

    def _worth_trying(self, nodes: Nodes) -> Mask:
        """Which nodes (M,) lie outside places that were the goal too often."""
        vain = [place for place, asks in self._asks.items() if asks >= _MAX_ASKS]
        if not vain:
            return np.ones(len(nodes), dtype=np.bool_)
        places = np.floor(nodes.centers_m / _PLACE_M).astype(np.int64)
        hit = (places[:, None] == np.array(vain)[None]).all(axis=2).any(axis=1)
        return np.asarray(~hit)

    def _best_leg(
        self,
        coverage: CoverageGrid,
        variance: FieldVariance,
        candidates: Mask,
        start: tuple[int, int],
        pose: Pose2,
    ) -> Leg | None:
        cols, side_m = coverage.geometry.cols, coverage.geometry.resolution_m
        labels = new_labels(coverage.moves.size)
        first = start[0] * cols + start[1]
        codes = np.ascontiguousarray(coverage.codes).ravel()
        wavefront(coverage.moves, codes, _ANY_CELL, first, math.inf, labels, 1)
        ends = _cell_of_nodes(variance.nodes)
        away_m = np.where(labels["wave"][ends] == 1, labels["cost"][ends], np.inf) * side_m
        time_s = away_m / self._driving.speed_m_s + _START_S
        goals = _goals(variance, np.where(candidates, time_s, np.inf))
        if not len(goals):
            return None
        of_cell = variance.nodes.of_cell.ravel().astype(np.int64)
        paths = [np.unique(of_cell[walk_back(labels, ends[g], cols)]) for g in goals]
        paths = [path[path >= 0] for path in paths]
        per_node = self._settings.readings_per_s * self._settings.node_side_m
        reductions = variance.variance_reductions(paths, per_node / self._driving.speed_m_s)
        to_goals = variance.nodes.centers_m[goals] - (pose.x, pose.y)
        turns_rad = np.arctan2(to_goals[:, 1], to_goals[:, 0]) - pose.theta
        turn_s = (
            np.array([abs(wrap_angle(float(a))) for a in turns_rad]) / self._driving.turn_rate_rad_s
        )
        for index in np.argsort(-reductions / (time_s[goals] + turn_s), kind="stable"):
            leg = self._leg_to(coverage, int(ends[goals[index]]), pose)
            if leg is not None:
                return leg
        return None

    def _leg_to(self, coverage: CoverageGrid, cell: int, pose: Pose2) -> Leg | None:
        cells = np.array([divmod(cell, coverage.geometry.cols)])
        end_m = anchors_m(coverage, cells)[0]
        x, y = np.floor(end_m / _PLACE_M).astype(np.int64).tolist()
        self._asks[x, y] += 1
        path = path_between(coverage.driving, np.array([pose.x, pose.y]), end_m)
        if path is None:
            return None
        path = without_collinear_points(path)
        return Leg(path, review_s=_REVIEW_S) if len(path) > 1 else None


def _cell_of_nodes(nodes: Nodes) -> NDArray[np.int64]:
    """Flat index (M,) of the cell nearest to the centre of each node."""
    cells = np.argwhere(nodes.of_cell >= 0)
    owner = nodes.of_cell[tuple(cells.T)]
    away = np.linalg.norm(nodes.geometry.center_of(cells) - nodes.centers_m[owner], axis=1)
    order = np.lexsort((away, owner))
    _, first = np.unique(owner[order], return_index=True)
    chosen = cells[order[first]]
    return np.asarray(chosen[:, 0] * nodes.of_cell.shape[1] + chosen[:, 1])


def _goals(variance: FieldVariance, time_s: Floats) -> NDArray[np.int64]:
    """Candidate nodes (G,) with the greatest variance over travel time, none near another."""
    rate = variance.variance_db2 / time_s
    chosen: list[int] = []
    while len(chosen) < _GOALS and rate.max(initial=0.0) > 0.0:
        best = int(rate.argmax())
        chosen.append(best)
        off = np.abs(variance.nodes.centers_m - variance.nodes.centers_m[best]).max(axis=1)
        rate[off < _APART_M] = 0.0
    return np.array(chosen, dtype=np.int64)
