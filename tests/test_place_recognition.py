# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures are found however far off and turned the estimated pose is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backend import silent
from slarm_graph.backends import closure_sets
from slarm_graph.backends.closure_sets import consistent_sets, pairwise_consistent
from slarm_graph.backends.final_closures import (
    _near_candidates,
    close_loops_offline,
    propagated,
    reassess_closures,
)
from slarm_graph.backends.submap_graph import GATED, SubmapGraph
from slarm_graph.config import FrontendConfig, PoseGraphConfig, SimulationConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.likelihood_grid import build_likelihood_grid, mean_likelihood
from slarm_graph.frontends.scans.place_recognition import PlaceIndex, describe_place
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.frontends.scans.submaps import Keyframe, make_submap, view_center
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Floats, Pose2, between, compose, invert, transform_points

LOOP = np.array([[-3.0, -2.8], [4.4, -2.2], [3.9, 2.6], [-4.2, 2.2], [-4.2, -2.9]])
AWAY = Pose2(23.0, -11.0, 2.2)
LOST = np.diag([1e7, 1e7, 1e5])
"""Covariance that minutes without a match add up to [m^2, m^2, rad^2]: more than can be."""


def walls(seed: int, count: int = 14) -> Floats:
    """Draw the returns (K, 2) of straight walls at random, one each 5 cm."""
    rng = np.random.default_rng(seed)
    starts, turns = rng.uniform(-12.0, 12.0, (count, 2)), rng.uniform(-np.pi, np.pi, count)
    lengths = rng.uniform(2.0, 8.0, count)
    along = [np.arange(0.0, length, 0.05)[:, None] for length in lengths]
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.concatenate([s + a * w for s, a, w in zip(starts, along, ways, strict=True)])


@pytest.mark.parametrize("turn_rad", [-2.9, -1.2, 0.05, 0.8, 2.3])
def test_a_place_is_told_from_others_with_how_it_lies(turn_rad: float) -> None:
    """A third of its walls has gone, others have come, and it is seen from another frame."""
    places = [walls(seed) for seed in range(8)]
    place_from_query = np.array([2.5, -1.8, turn_rad])
    seen = np.concatenate([places[5][len(places[5]) // 3 :], walls(100, 4)])
    seen = seen + np.random.default_rng(2).normal(0.0, 0.02, seen.shape)
    query = transform_points(invert(place_from_query), seen)
    appearances = [describe_place(p, np.median(p, axis=0)) for p in (*places, query)]
    best = PlaceIndex(appearances).most_similar(8, np.arange(8), 3)[0]
    assert best.place == 5
    away = between(place_from_query, best.place_from_query)
    assert np.hypot(away[0], away[1]) < 0.75
    assert abs(away[2]) < np.radians(2.5)


def test_mean_likelihood_is_that_of_a_wall() -> None:
    """On the wall 1, a standard deviation beside it exp(-1/2), and nothing far from it."""
    grid = build_likelihood_grid(np.array([[0.0, 0.0, 4.0, 0.0]]), resolution_m=0.05, sigma_m=0.1)
    pose = np.array([1.0, 0.5, -np.pi / 2])
    for off_m, expected in ((0.0, 1.0), (0.1, np.exp(-0.5)), (2.0, 0.0)):
        points = np.array([[0.5 + off_m, 0.0], [0.5 + off_m, 1.0]])
        assert mean_likelihood(grid, points, pose) == pytest.approx(expected, abs=0.02)
    assert mean_likelihood(grid, np.zeros((0, 2)), pose) == 0.0


@pytest.fixture(scope="module")
def twice() -> list[Keyframe]:
    """Keyframes of a drive round the paper's room; the second half of them is lost in between."""
    source = SourceFromWorld(
        load_world("paper_room"),
        SimulationConfig(),
        seed=3,
        script=waypoints(np.concatenate([LOOP, LOOP, LOOP[:2]])),
    )
    tracker = ScanTracker(FrontendConfig())
    tracked = [t for t in map(tracker.track, source) if t.is_keyframe]
    keyframes = [
        Keyframe(k, t.points_m, t.local_from_robot, np.eye(3) * 1e-6, view_center(t.points_m))
        for k, t in enumerate(tracked)
    ]
    half = len(keyframes) // 2
    moved = [replace(k, local_from_robot=AWAY @ k.local_from_robot) for k in keyframes[half:]]
    moved[0] = replace(moved[0], covariance=LOST)
    return [*keyframes[:half], *moved]


def matcher_of(keyframes: list[Keyframe], graph: SubmapGraph) -> SubmapMatcher:
    return SubmapMatcher(
        PoseGraphConfig().loops, FrontendConfig().matching, keyframes, graph.submaps
    )


def test_a_submap_is_aligned_in_a_region(twice: list[Keyframe]) -> None:
    first = twice[: len(twice) // 2]
    again = [replace(k, local_from_robot=AWAY @ k.local_from_robot) for k in first[20:30]]
    keyframes = [*first, *again]
    submaps = [make_submap(keyframes, k, k + 10, k) for k in range(0, 40, 10)]
    count = len(first)
    submaps.append(make_submap(keyframes, count, count + 10, count))
    loops, matching = PoseGraphConfig().loops, FrontendConfig().matching
    matcher = SubmapMatcher(loops, matching, keyframes, submaps)
    found = matcher.align(4, 2, np.array([0.4, -0.3, 0.12]))
    assert not found.reason
    assert found.score > 0.9
    assert np.abs(found.submap_from_keyframe).max() < 0.005
    assert matcher.align(4, 2, np.array([0.0, 0.0, np.pi])).reason


def test_what_an_earlier_matcher_built_is_that_of_a_fresh_one(twice: list[Keyframe]) -> None:
    """Static returns near its end change when the recording goes on; those before do not."""
    # Each fifth beam ends at a passer-by, whom no other scan sees there.
    rng = np.random.default_rng(0)
    keyframes = [
        replace(k, points_m=np.where(rng.random((len(k.points_m), 1)) < 0.2, 0.7, 1.0) * k.points_m)
        for k in twice
    ]
    starts = range(0, len(keyframes) - 5, 5)
    submaps = [make_submap(keyframes, k, k + 5, k) for k in starts]
    settings = PoseGraphConfig().loops, FrontendConfig().matching
    half = len(submaps) // 2
    # The recording ended in the middle of the next submap.
    earlier = SubmapMatcher(*settings, keyframes[: submaps[half].first + 2], submaps[:half])
    stale = [earlier.appearance(k) for k in range(half)]
    walls = [earlier.evidence_against(k, k, np.zeros(3)) for k in range(half)]
    later = SubmapMatcher(*settings, keyframes, submaps, earlier)
    fresh = SubmapMatcher(*settings, keyframes, submaps)
    for k in range(len(submaps)):
        np.testing.assert_array_equal(later.appearance(k).walls_m, fresh.appearance(k).walls_m)
        evidence = [m.evidence_against(k, k, np.zeros(3)) for m in (later, fresh)]
        assert evidence[0] == evidence[1]
    assert walls == [fresh.evidence_against(k, k, np.zeros(3)) for k in range(half)]
    taken = [later.appearance(k) is stale[k] for k in range(half)]
    assert all(taken[: half - 5])
    assert not any(taken[half - 3 :])


def test_places_of_one_region_are_described_each_from_its_own_middle(twice: list[Keyframe]) -> None:
    submaps = [make_submap(twice, k, k + 5, k) for k in range(0, 15, 5)]
    matcher = SubmapMatcher(PoseGraphConfig().loops, FrontendConfig().matching, twice, submaps)
    for k in range(3):
        middle = np.median(matcher.points_of(matcher.region(k, 0)), axis=0)
        np.testing.assert_array_equal(matcher.appearance(k).middle_m, middle)


def test_a_robot_that_was_lost_is_brought_back(twice: list[Keyframe]) -> None:
    """Kidnapped by 25 m and two radians: recovered by place recognition."""
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in twice:
        graph.add(keyframe)
    local = np.array([k.local_from_robot.as_array() for k in twice])
    half = len(twice) // 2
    true = np.concatenate([local[:half], compose(AWAY.inverse().as_array(), local[half:])])

    def error_m(graph: SubmapGraph) -> float:
        away = between(true, graph.correct_trajectory(local, np.ones(len(local))))
        return float(np.hypot(away[half:, 0], away[half:, 1]).max())

    assert error_m(graph) > 10.0
    closed, _ = close_loops_offline(graph, matcher_of(twice, graph), silent)
    closed.optimize_robustly()
    assert error_m(closed) < 0.1


def test_a_closure_is_propagated_to_both_sides_while_submaps_match(twice: list[Keyframe]) -> None:
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in twice:
        graph.add(keyframe)
    matcher, nodes = matcher_of(twice, graph), graph.poses()
    true = nodes.copy()
    half = graph.node_of(len(twice) // 2)
    true[half:] = compose(AWAY.inverse().as_array(), nodes[half:])
    query = (half + len(graph.submaps)) // 2
    near = int(np.argmin(np.hypot(*(true[: half - 1] - true[query])[:, :2].T)))
    closure = matcher.align(query, near, between(true[near], true[query]))
    assert not closure.reason
    further = list(propagated([closure], graph, matcher))
    assert {graph.node_of(c.keyframe) - query for c in further} >= {-2, -1, 1, 2}
    for c in further:
        there = between(true[c.submap], true[graph.node_of(c.keyframe)])
        assert np.abs(between(there, c.submap_from_keyframe)).max() < 0.1
        assert not c.searched
    wrong = replace(
        closure, submap_from_keyframe=closure.submap_from_keyframe + np.array([4.0, -3.0, 1.0])
    )
    assert len(list(propagated([wrong], graph, matcher))) < 2


def test_closures_with_a_consistent_loop_agree(twice: list[Keyframe]) -> None:
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in twice:
        graph.add(keyframe)
    half = len(twice) // 2
    first, second = half + 3, half + 12

    def found(keyframe: int, submap: int, off_m: float = 0.0, off_rad: float = 0.0) -> Closure:
        old = twice[graph.submaps[submap].anchor].local_from_robot
        new = AWAY.inverse() @ twice[keyframe].local_from_robot
        pose = (old.inverse() @ new @ Pose2(off_m, 0.0, off_rad)).as_array()
        return Closure(submap, keyframe, pose, np.eye(3), 0.9, True)

    one = found(first, 0)
    closures = [
        one,
        found(second, 1),
        found(second, 1, off_m=0.5),
        found(second, 1, off_rad=0.3),
        found(first, 1),
    ]
    pairs = np.array([(0, k) for k in range(1, 5)])
    agree = pairwise_consistent(closures, pairs, graph).tolist()
    assert agree == [True, False, False, False], "one scan cannot confirm itself"
    three = [one, found(second, 1), found(half + 22, 2), found(half + 16, 1, off_m=3.0)]
    assert consistent_sets(three, graph) == three[:3]
    assert consistent_sets([three[0], three[2]], graph) == []


def test_an_aliased_closure_fails_the_gate(twice: list[Keyframe]) -> None:
    """A graph of small covariance rejects a closure two metres off."""
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in twice[: len(twice) // 2]:
        graph.add(keyframe)
    last = len(graph.keyframes) - 1
    old, new = twice[graph.submaps[0].anchor].local_from_robot, twice[last].local_from_robot
    expected = old.between(new)

    def closure_off(away_m: float) -> Closure:
        pose = (expected @ Pose2(away_m, 0.0, 0.0)).as_array()
        return Closure(0, last, pose, np.eye(3) * 1e6, 0.95, True)

    graph.add_closures(graph.apply_gate([closure_off(0.05), closure_off(2.0), closure_off(-0.05)]))
    assert [not c.reason for c in graph.closures] == [True, False, True]
    assert (
        closure_sets.log_odds_nat(graph, closure_off(0.0), 10.0)
        > 5.0
        > closure_sets.log_odds_nat(graph, closure_off(2.0), 10.0)
    )
    assert closure_sets.log_odds_nat(graph, closure_off(0.0), 1.0) < closure_sets.log_odds_nat(
        graph, closure_off(0.0), 10.0
    )


def corridor(there_m: float) -> SubmapGraph:
    """A path along a line and back, with a standard deviation of 2 cm a step."""
    out = np.arange(0.0, there_m, 0.4)
    poses = [*(Pose2(x) for x in out), *(Pose2(x, 0.0, np.pi) for x in out[::-1])]
    graph = SubmapGraph(PoseGraphConfig())
    unsure = np.diag([4e-4, 1e-6, 1e-8])
    for k, pose in enumerate(poses):
        graph.add(Keyframe(k, np.zeros((0, 2)), pose, unsure, np.zeros(2)))
    return graph


def test_the_outcome_does_not_depend_on_what_was_accepted_first() -> None:
    """Aliased doors a metre on: three false closures were accepted, then four true ones gated.

    Odometry allows either, and the four outnumber the three.
    """
    graph = corridor(30.0)
    last = len(graph.keyframes) - 1

    def found(keyframe: int, submap: int, off_m: float) -> Closure:
        old, new = graph.keyframes[graph.submaps[submap].anchor], graph.keyframes[keyframe]
        step = (old.local_from_robot.inverse() @ Pose2(off_m) @ new.local_from_robot).as_array()
        return Closure(submap, keyframe, step, np.diag([1e4, 1e4, 1e6]), 0.9, True)

    wrong = [found(last - 2 - 9 * k, k, 1.0) for k in range(3)]
    right = [found(last - 5 * k, k, 0.0) for k in range(4)]
    graph.add_closures(graph.apply_gate(wrong))
    assert not any(c.reason for c in graph.closures)
    graph.optimize_robustly()
    graph.add_closures(graph.apply_gate(right))
    assert [c.reason for c in graph.closures] == 3 * [""] + 4 * [GATED]
    contested = closure_sets.contested_closures(graph)
    assert contested == wrong
    graph = reassess_closures(graph, contested)
    _, weights = graph.optimize_robustly()
    accepted = [c for c, w in zip(graph.closures, weights, strict=True) if w > 0.5]
    expected = [c.submap_from_keyframe.tobytes() for c in right]
    assert [c.submap_from_keyframe.tobytes() for c in accepted] == expected
    np.testing.assert_allclose(graph.map_from_local().as_array(), 0.0, atol=0.1)


def test_a_rejected_closure_does_not_lower_covariances() -> None:
    """A false closure that robust optimisation rejected hides no true one beside it."""
    graph = corridor(30.0)
    last = len(graph.keyframes) - 1
    node = graph.node_of(last)

    def found(keyframe: int, off_m: float) -> Closure:
        pose = Pose2(off_m) @ graph.keyframes[keyframe].local_from_robot
        return Closure(0, keyframe, pose.as_array(), np.diag([1e4, 1e4, 1e6]), 0.9, True)

    alone = graph.sigmas_between(0, node)
    graph.add_closures([found(last, 5.0)])
    assert graph.sigmas_between(0, node)[0] < 0.2 * alone[0]
    assert graph.nodes_with_closure() == {node}
    _, weights = graph.optimize_robustly()
    assert weights.tolist() == [0.0]
    assert graph.sigmas_between(0, node) == pytest.approx(alone, rel=1e-6)
    assert graph.nodes_with_closure() == set()
    true = graph.apply_gate([found(last - 1, 0.0)])
    assert not true[0].reason
    graph.add_closures(true)
    _, weights = graph.optimize_robustly()
    assert weights.tolist() == [0.0, 1.0]
    assert graph.sigmas_between(0, node)[0] < 0.2 * alone[0]


def test_a_long_chain_of_closures_is_one_set(
    twice: list[Keyframe], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pairwise consistent along a path whose ends are too far apart to be compared."""
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in twice:
        graph.add(keyframe)
    monkeypatch.setattr(closure_sets, "_NEIGHBOURS_M", 4.0)
    half = len(twice) // 2

    def found(keyframe: int, submap: int, off_m: float = 0.0) -> Closure:
        old = twice[graph.submaps[submap].anchor].local_from_robot
        new = AWAY.inverse() @ twice[keyframe].local_from_robot
        pose = (old.inverse() @ Pose2(off_m, 0.0, 0.0) @ new).as_array()
        return Closure(submap, keyframe, pose, np.eye(3), 0.9, True)

    chain = [found(half + 3 + 4 * k, k // 3) for k in range(12)]
    ways = [graph.path_length_at(c.keyframe) for c in chain]
    assert ways[-1] - ways[0] > 7.0
    rival = found(half + 8, 0, off_m=3.0)
    assert consistent_sets([*chain, rival], graph) == chain


@pytest.mark.parametrize(("i", "j"), [(1, 5), (5, 1), (9, 11)])
def test_without_closures_relative_covariances_are_those_of_dead_reckoning(
    twice: list[Keyframe], i: int, j: int
) -> None:
    graph = SubmapGraph(PoseGraphConfig())
    for keyframe in twice:
        graph.add(keyframe)
    covariance = graph.dead_reckoning_covariances(np.array([i]), np.array([j]))[0]
    sigma_m, sigma_rad = graph.sigmas_between(i, j)
    assert sigma_m == pytest.approx(np.sqrt(covariance[0, 0] + covariance[1, 1]))
    assert sigma_rad == pytest.approx(np.sqrt(covariance[2, 2]))


def test_candidates_near_the_prediction_need_a_certain_graph(
    twice: list[Keyframe],
) -> None:
    """None after being lost between two laps; some where odometry held."""
    half = len(twice) // 2
    back = [replace(k, local_from_robot=AWAY.inverse() @ k.local_from_robot) for k in twice[half:]]
    asked = {}
    for name, covariance in (("lost", LOST), ("sure", twice[1].covariance)):
        graph = SubmapGraph(PoseGraphConfig())
        for keyframe in [*twice[:half], replace(back[0], covariance=covariance), *back[1:]]:
            graph.add(keyframe)
        asked[name] = list(_near_candidates(graph, set()))
        again = graph.node_of(half)
        assert all(j >= again for j, _, _ in asked[name])
    assert not asked["lost"]
    assert len(asked["sure"]) > 3


def test_a_submap_is_made_once_it_reaches_half_a_node_beyond_the_next(
    twice: list[Keyframe],
) -> None:
    """As soon, not before: of ten keyframes five to either side of its own."""
    graph = SubmapGraph(PoseGraphConfig(node_m=1e9))
    for count, keyframe in enumerate(twice[:41], start=1):
        graph.add(keyframe)
        assert len(graph.submaps) == max(0, (count - 5) // 10)
    found = [(s.first, s.anchor, s.last) for s in graph.submaps]
    assert found == [(0, 0, 15), (5, 10, 25), (15, 20, 35)]
