# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Closures that lay places upon each other which are others are found out by what is beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backend import silent
from slarm_graph.backends.closure_sets import stories
from slarm_graph.backends.graph_building import _misfit_notice
from slarm_graph.backends.misfits import MISFITS, _against, _beside, beside_each_other, reconciled
from slarm_graph.backends.submap_graph import FAR_OFF, SubmapGraph
from slarm_graph.config import FrontendConfig, PoseGraphConfig, SimulationConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.frontends.scans.submaps import Keyframe, view_center
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Pose2, between

LOOP = np.array([[-3.0, -2.8], [4.4, -2.2], [3.9, 2.6], [-4.2, 2.2], [-4.2, -2.9]])
OFF = Pose2(1.2, 0.8, 0.2)
"""Where the second lap is taken to be, by tracking that was sure of itself, or by a false story."""
SURE, LOST = np.eye(3) * 1e-6, np.diag([2.0, 2.0, 0.5]) ** 2
TOO_SURE = np.diag([0.03, 0.03, 0.02]) ** 2
"""Of a step that has erred by OFF, as matches along a bare corridor do."""


@pytest.fixture(scope="module")
def laps() -> list[Keyframe]:
    """Keyframes of two laps of the paper's room, where they were."""
    way = waypoints(np.concatenate([LOOP, LOOP]))
    source = SourceFromWorld(load_world("paper_room"), SimulationConfig(), seed=3, script=way)
    tracker = ScanTracker(FrontendConfig())
    tracked = [t for t in map(tracker.track, source) if t.is_keyframe]
    return [
        Keyframe(k, t.points_m, t.local_from_robot, SURE, view_center(t.points_m))
        for k, t in enumerate(tracked)
    ]


def torn(laps: Sequence[Keyframe], off: Pose2, covariance: np.ndarray) -> SubmapGraph:
    """A graph of two laps of which the second lies off, by a step that is so sure."""
    half, graph = len(laps) // 2, SubmapGraph(PoseGraphConfig())
    for keyframe in laps[:half]:
        graph.add(keyframe)
    moved = [replace(k, local_from_robot=off @ k.local_from_robot) for k in laps[half:]]
    for keyframe in (replace(moved[0], covariance=covariance), *moved[1:]):
        graph.add(keyframe)
    return graph


def matcher_of(graph: SubmapGraph) -> SubmapMatcher:
    loops, matching = PoseGraphConfig().loops, FrontendConfig().matching
    return SubmapMatcher(loops, matching, graph.keyframes, graph.submaps)


def finds(graph: SubmapGraph, laps: Sequence[Keyframe], off: Pose2) -> list[Closure]:
    """Closures of the second lap in submaps of the first, off by a pose in the map."""
    half = len(laps) // 2
    first = [s for s in graph.submaps if s.last < half - 10]
    at = [laps[s.anchor].local_from_robot for s in first]
    told = []
    for new in range(half + 15, len(laps) - 5, 5):
        here = off @ laps[new].local_from_robot
        away = [np.hypot(*between(p.as_array(), here.as_array())[:2]) for p in at]
        old = int(np.argmin(away))
        if away[old] < 2.5:
            pose = (at[old].inverse() @ here).as_array()
            told.append(Closure(old, new, pose, np.eye(3) * 1e4, 0.9, True))
    assert len(told) > 3
    return told


def error_m(graph: SubmapGraph, laps: Sequence[Keyframe]) -> float:
    """How far the farthest node lies from where it was."""
    true = np.array([laps[k].local_from_robot.as_array() for k in graph.node_scans()])
    return float(np.hypot(*between(true, graph.poses())[:, :2].T).max())


def test_places_that_lie_right_contradict_nothing(laps: list[Keyframe]) -> None:
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in laps:
        graph.add(keyframe)
    said = beside_each_other(graph, matcher_of(graph))
    assert _against(said) < 1.0
    off = torn(laps, OFF, SURE)
    against = beside_each_other(off, matcher_of(off))
    assert _against(against) > 20.0
    assert against[:, 2].sum() > said[:, 2].sum() + 20.0
    half = off.node_of(len(laps) // 2)
    assert ((against[:, 0] < half) & (against[:, 1] >= half - 1))[against[:, 2] > 1.0].all()
    assert reconciled(graph, matcher_of(graph), silent) is graph


def test_a_false_story_is_not_believed(laps: list[Keyframe]) -> None:
    """Nothing but the story says where the second lap lies, and walls stand where it drove."""
    graph = torn(laps, Pose2(), LOST)
    false = finds(graph, laps, OFF)
    graph.close(false)
    graph.settle()
    assert error_m(graph, laps) > 1.0
    assert len(stories(false, graph)) == 1
    better = reconciled(graph, matcher_of(graph), silent)
    _, weights = better.settle()
    assert weights.max() < 0.5
    assert error_m(better, laps) < 0.1
    assert MISFITS in {c.reason for c in better.closures}
    (told,) = _misfit_notice(better.closures)
    assert told.startswith(f"{sum(c.reason == MISFITS for c in better.closures)} loop closures")
    assert _misfit_notice(graph.closures) == ()
    assert {c.reason for c in graph.closures} == {""}, "the graph given is left as it was"


def test_a_true_story_is(laps: list[Keyframe]) -> None:
    """It moves the second lap by more than a metre, too, and takes contradictions away."""
    graph = torn(laps, OFF, LOST)
    assert error_m(graph, laps) > 1.0
    graph.close(finds(graph, laps, Pose2()))
    better = reconciled(graph, matcher_of(graph), silent)
    assert better is graph
    assert error_m(better, laps) < 0.1


def test_a_true_story_that_was_turned_down_is_believed_where_places_contradict_each_other(
    laps: list[Keyframe],
) -> None:
    """The step between the laps is too sure of itself: what speaks against it is far off."""
    graph = torn(laps, OFF, TOO_SURE)
    true = graph.judged(finds(graph, laps, Pose2()))
    assert {c.reason for c in true} == {FAR_OFF}
    graph.close(true)
    graph.settle()
    assert error_m(graph, laps) > 1.0
    better = reconciled(graph, matcher_of(graph), silent)
    assert better.settle()[1].min() > 0.5
    assert error_m(better, laps) < 0.1
    assert {c.reason for c in graph.closures} == {FAR_OFF}, "the graph given is left as it was"


@pytest.mark.parametrize("off", [Pose2(), OFF])
def test_a_false_one_stays_down(laps: list[Keyframe], off: Pose2) -> None:
    """Whether there is nothing to mend, or something that it does not."""
    graph = torn(laps, off, TOO_SURE)
    false = graph.judged(finds(graph, laps, Pose2(-1.4, 0.9, -0.3)))
    assert {c.reason for c in false} == {FAR_OFF}
    graph.close(false)
    error_before_m = error_m(graph, laps)
    better = reconciled(graph, matcher_of(graph), silent)
    assert error_m(better, laps) == pytest.approx(error_before_m, abs=0.05)
    assert better.settle()[1].max() < 0.5


def test_of_two_stories_the_one_that_fits_stays(laps: list[Keyframe]) -> None:
    """The second lap hangs on either; which, its neighbours tell."""
    graph = torn(laps, OFF, LOST)
    true, false = (finds(graph, laps, off) for off in (Pose2(), OFF))
    graph.close([*true[:2], *false])
    better = reconciled(graph, matcher_of(graph), silent)
    weights = better.settle()[1]
    assert weights[:2].max() > 0.5
    assert weights[2:].max() < 0.5
    assert error_m(better, laps) < 0.1


def test_a_story_is_asked_for_what_lies_beside_it(laps: list[Keyframe]) -> None:
    graph = torn(laps, OFF, LOST)
    true, false = (finds(graph, laps, off) for off in (Pose2(), OFF))
    told = stories([*true, *false], graph)
    assert sorted(map(len, told)) == [len(true), len(false)]
    one = true[-1]
    node = graph.node_of(one.keyframe)
    here, there = [one.submap, node, 3.0], [0, 1, 5.0]
    confirmed = [one.submap, node, -9.0]
    against = np.array([here, here, there, confirmed], dtype=np.float64)
    assert _beside([one], graph, against) == 6.0
    assert _beside(true, graph, against[:0]) == 0.0


def test_a_story_without_which_a_lap_floats_away_stays(laps: list[Keyframe]) -> None:
    """Far off nothing contradicts it, but nothing confirms it either."""
    graph = torn(laps, Pose2(25.0, 0.0, 0.0), 25.0 * LOST)
    slightly = Pose2(0.3, 0.15, 0.03)
    graph.close(finds(graph, laps, slightly))
    graph.settle()
    matcher = matcher_of(graph)
    assert _against(beside_each_other(graph, matcher)) > 5.0
    assert reconciled(graph, matcher, silent) is graph
