# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""False closures that overlay different places are rejected by the submaps beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backend import silent
from slarm_graph.backends.closure_sets import agreeing_groups
from slarm_graph.backends.closure_verification import (
    CONTRADICTED,
    _contradiction,
    _contradiction_near,
    overlap_evidence,
    verify_closures,
)
from slarm_graph.backends.graph_building import _contradicted_notice
from slarm_graph.backends.submap_graph import GATED, SubmapGraph
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
"""Where the second lap is taken to be, by overconfident tracking or by false closures."""
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
    """A graph of two laps, the second displaced by a step of the given covariance."""
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
    closures = []
    for new in range(half + 15, len(laps) - 5, 5):
        here = off @ laps[new].local_from_robot
        distances_m = [np.hypot(*between(p.as_array(), here.as_array())[:2]) for p in at]
        old = int(np.argmin(distances_m))
        if distances_m[old] < 2.5:
            pose = (at[old].inverse() @ here).as_array()
            closures.append(Closure(old, new, pose, np.eye(3) * 1e4, 0.9, True))
    assert len(closures) > 3
    return closures


def error_m(graph: SubmapGraph, laps: Sequence[Keyframe]) -> float:
    """How far the farthest node lies from where it was."""
    true = np.array([laps[k].local_from_robot.as_array() for k in graph.node_scans()])
    return float(np.hypot(*between(true, graph.poses())[:, :2].T).max())


def test_right_poses_have_no_contradiction(laps: list[Keyframe]) -> None:
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in laps:
        graph.add(keyframe)
    evidence = overlap_evidence(graph, matcher_of(graph))
    assert _contradiction(evidence) < 1.0
    off = torn(laps, OFF, SURE)
    against = overlap_evidence(off, matcher_of(off))
    assert _contradiction(against) > 20.0
    assert against[:, 2].sum() > evidence[:, 2].sum() + 20.0
    half = off.node_of(len(laps) // 2)
    assert ((against[:, 0] < half) & (against[:, 1] >= half - 1))[against[:, 2] > 1.0].all()
    assert verify_closures(graph, matcher_of(graph), silent) is graph


def test_a_false_group_is_rejected(laps: list[Keyframe]) -> None:
    """Nothing but the group ties the second lap, and walls stand where it drove."""
    graph = torn(laps, Pose2(), LOST)
    false = finds(graph, laps, OFF)
    graph.add_closures(false)
    graph.optimize_robustly()
    assert error_m(graph, laps) > 1.0
    assert len(agreeing_groups(false, graph)) == 1
    better = verify_closures(graph, matcher_of(graph), silent)
    _, weights = better.optimize_robustly()
    assert weights.max() < 0.5
    assert error_m(better, laps) < 0.1
    assert CONTRADICTED in {c.reason for c in better.closures}
    (notice,) = _contradicted_notice(better.closures)
    assert notice.startswith(
        f"{sum(c.reason == CONTRADICTED for c in better.closures)} loop closures"
    )
    assert _contradicted_notice(graph.closures) == ()
    assert {c.reason for c in graph.closures} == {""}, "the graph given is left as it was"


def test_a_true_group_is_kept(laps: list[Keyframe]) -> None:
    """It moves the second lap by more than a metre, too, and takes contradictions away."""
    graph = torn(laps, OFF, LOST)
    assert error_m(graph, laps) > 1.0
    graph.add_closures(finds(graph, laps, Pose2()))
    better = verify_closures(graph, matcher_of(graph), silent)
    assert better is graph
    assert error_m(better, laps) < 0.1


def test_a_gated_true_group_is_readmitted_where_submaps_contradict(
    laps: list[Keyframe],
) -> None:
    """The step between the laps is overconfident, so that true closures fail the gate."""
    graph = torn(laps, OFF, TOO_SURE)
    true = graph.apply_gate(finds(graph, laps, Pose2()))
    assert {c.reason for c in true} == {GATED}
    graph.add_closures(true)
    graph.optimize_robustly()
    assert error_m(graph, laps) > 1.0
    better = verify_closures(graph, matcher_of(graph), silent)
    assert better.optimize_robustly()[1].min() > 0.5
    assert error_m(better, laps) < 0.1
    assert {c.reason for c in graph.closures} == {GATED}, "the graph given is left as it was"


@pytest.mark.parametrize("off", [Pose2(), OFF])
def test_a_gated_false_group_stays_rejected(laps: list[Keyframe], off: Pose2) -> None:
    """Whether there is no contradiction, or one that it does not remove."""
    graph = torn(laps, off, TOO_SURE)
    false = graph.apply_gate(finds(graph, laps, Pose2(-1.4, 0.9, -0.3)))
    assert {c.reason for c in false} == {GATED}
    graph.add_closures(false)
    error_before_m = error_m(graph, laps)
    better = verify_closures(graph, matcher_of(graph), silent)
    assert error_m(better, laps) == pytest.approx(error_before_m, abs=0.05)
    assert better.optimize_robustly()[1].max() < 0.5


def test_of_two_groups_the_one_without_contradiction_stays(laps: list[Keyframe]) -> None:
    """The second lap hangs on either; the submaps beside it decide."""
    graph = torn(laps, OFF, LOST)
    true, false = (finds(graph, laps, off) for off in (Pose2(), OFF))
    graph.add_closures([*true[:2], *false])
    better = verify_closures(graph, matcher_of(graph), silent)
    weights = better.optimize_robustly()[1]
    assert weights[:2].max() > 0.5
    assert weights[2:].max() < 0.5
    assert error_m(better, laps) < 0.1


def test_contradiction_is_summed_near_a_group(laps: list[Keyframe]) -> None:
    graph = torn(laps, OFF, LOST)
    true, false = (finds(graph, laps, off) for off in (Pose2(), OFF))
    groups = agreeing_groups([*true, *false], graph)
    assert sorted(map(len, groups)) == [len(true), len(false)]
    one = true[-1]
    node = graph.node_of(one.keyframe)
    here, there = [one.submap, node, 3.0], [0, 1, 5.0]
    confirmed = [one.submap, node, -9.0]
    against = np.array([here, here, there, confirmed], dtype=np.float64)
    assert _contradiction_near([one], graph, against) == 6.0
    assert _contradiction_near(true, graph, against[:0]) == 0.0
    early, late = replace(one, submap=0, keyframe=0), len(graph.poses()) - 1
    one_end = np.array([[0, late, 2.0], [late, 0, 2.5], [late, late, 1.0]])
    assert _contradiction_near([early], graph, one_end) == 0.0
    assert _contradiction_near([early], graph, one_end, both=False) == 4.5


def test_a_group_stays_that_alone_ties_a_lap(laps: list[Keyframe]) -> None:
    """Far off nothing contradicts it, but nothing confirms it either."""
    graph = torn(laps, Pose2(25.0, 0.0, 0.0), 25.0 * LOST)
    slightly = Pose2(0.3, 0.15, 0.03)
    graph.add_closures(finds(graph, laps, slightly))
    graph.optimize_robustly()
    matcher = matcher_of(graph)
    assert _contradiction(overlap_evidence(graph, matcher)) > 5.0
    assert verify_closures(graph, matcher, silent) is graph
