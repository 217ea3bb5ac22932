# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""When old places are looked for, which of them, how far about, and what speaks against a find."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.config import LoopClosureConfig, MatchingConfig
from slarm_graph.frontends.scans import loop_closure
from slarm_graph.frontends.scans.closures import GATE_SIGMAS, Closure, ClosureCandidates
from slarm_graph.frontends.scans.loop_closure import LoopCloser, rejection_reason
from slarm_graph.frontends.scans.submaps import Keyframe, Submap, make_submap
from slarm_graph.geometry import Floats, Pose2

Calls = list[tuple[int, float, float, float]]
"""Keyframe, x of where a search is about [m], and its reaches [m, rad]."""


def keyframes(count: int) -> list[Keyframe]:
    wall = np.stack([np.linspace(-1.0, 1.0, 41), np.full(41, 2.0)], axis=1)
    poses = [Pose2(0.1 * k, 0.0, 0.0) for k in range(count)]
    return [Keyframe(k, wall, pose, np.eye(3), np.zeros(2)) for k, pose in enumerate(poses)]


def expected(sigma_m: list[float], sigma_rad: list[float]) -> ClosureCandidates:
    """Of as many submaps as there are sigmas, each expected at its number [m]."""
    count = len(sigma_m)
    poses = np.column_stack([np.arange(float(count)), np.zeros((count, 2))])
    return ClosureCandidates(np.arange(count), poses, np.array(sigma_m), np.array(sigma_rad))


def examined(
    monkeypatch: pytest.MonkeyPatch, config: LoopClosureConfig, where: ClosureCandidates, count: int
) -> tuple[Calls, list[tuple[int, int]]]:
    """Searches that find nothing, and matches where the graph is sure, over some keyframes."""
    way, searched, matched = keyframes(count), [], []
    submaps: list[Submap] = [make_submap(way, 0, 1, 0)] * len(where.submap)

    def search(
        _pyramid: object,
        _points: Floats,
        center: Pose2,
        *,
        reach_m: float,
        reach_rad: float,
        **_: float,
    ) -> None:
        searched.append((k, center.x, reach_m, reach_rad))

    def refine(_self: LoopCloser, at: int, submap: int, start: Floats, *_: object) -> Closure:
        matched.append((at, submap))
        return Closure(submap, at, start, np.eye(3), 0.0, False)

    monkeypatch.setattr(loop_closure, "search", search)
    monkeypatch.setattr(LoopCloser, "_refine", refine)
    closer = LoopCloser(config, MatchingConfig())
    for k in range(count):
        done = closer.examine(way[: k + 1], submaps, where)
        assert [c.keyframe for c in done] == [k] * len(done)
    return searched, matched


def test_searches_in_vain_become_rarer(monkeypatch: pytest.MonkeyPatch) -> None:
    """From every fourth keyframe on by half more each time, up to sixteen times as seldom."""
    config = LoopClosureConfig(search_every=4, search_again=1)
    searched, matched = examined(monkeypatch, config, expected([0.5], [0.5]), 330)
    assert [k for k, *_ in searched] == [0, 6, 15, 29, 50, 81, 127, 191, 255, 319]
    assert matched == []


def test_the_same_place_is_searched_again_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nearest first, two at a time; those just tried make room for others."""
    config = LoopClosureConfig(search_every=4, search_again=15, searches=2)
    searched, _ = examined(monkeypatch, config, expected([0.5] * 5, [0.5] * 5), 30)
    told = [(k, x) for k, x, *_ in searched]
    assert told == [(0, 0), (0, 1), (6, 2), (6, 3), (15, 0), (15, 1), (29, 2), (29, 3)]


def test_where_the_graph_is_sure_nothing_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to 0.2 m and 0.07 rad; of several such places the nearest is matched."""
    config = LoopClosureConfig(candidates=1, match_every=3)
    both = expected([0.21, 0.2, 0.1, 0.2], [0.07, 0.07, 0.05, 0.08])
    searched, matched = examined(monkeypatch, config, both, 8)
    assert matched == [(0, 1), (3, 1), (6, 1)]
    assert [(k, x) for k, x, *_ in searched] == [(0, 0), (0, 3)]
    several = LoopClosureConfig(candidates=2, match_every=3)
    sure = expected([0.2, 0.1], [0.07, 0.05])
    searched, matched = examined(monkeypatch, several, sure, 4)
    assert matched == [(0, 0), (0, 1), (3, 0), (3, 1)]
    assert searched == []


def test_a_window_is_as_wide_as_the_graph_may_err_within_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config = LoopClosureConfig(window_m=3.0, window_rad=1.5)
    where = expected([0.5, 5.0], [0.9, 0.2])
    searched, _ = examined(monkeypatch, config, where, 1)
    assert searched == [
        (0, 0.0, pytest.approx(GATE_SIGMAS * 0.5), 1.5),
        (0, 1.0, 3.0, pytest.approx(GATE_SIGMAS * 0.2)),
    ]


def test_a_keyframe_is_due_by_what_was_done_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_closure, "search", lambda *_, **__: None)
    way = keyframes(30)
    submaps = [make_submap(way, 0, 1, 0)]
    closer = LoopCloser(LoopClosureConfig(match_every=5, search_every=3), MatchingConfig())
    assert closer.is_due(0)
    closer.examine(way[:11], submaps, expected([0.5], [0.5]))
    assert [closer.is_due(k) for k in (11, 12, 13, 14)] == [False, False, True, True]


@pytest.mark.parametrize(
    ("score", "sigma_m", "behind", "reason"),
    [
        (0.5, 0.15, 0.5, ""),
        (0.49, 0.1, 0.0, "score 0.49"),
        (0.6, 0.16, 0.0, "slides along a wall"),
        (0.6, 0.1, 0.51, "sees the other side of its walls"),
        (0.4, 0.2, 0.9, "score 0.40"),
    ],
)
def test_what_is_wrong_with_a_match(
    score: float, sigma_m: float, behind: float, reason: str
) -> None:
    """The least sure direction decides, whichever it is; a heading says nothing of it."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    information = np.full((3, 3), 0.1)
    information[:2, :2] = turn @ np.diag([1.0001 / sigma_m**2, 900.0]) @ turn.T
    assert rejection_reason(score, information, behind, LoopClosureConfig()) == reason


def test_the_latest_keyframes_are_searched_for_together() -> None:
    """In the newest one's frame, one return a cell, none beyond 12 m, and not too many."""
    way = keyframes(12)
    closer = LoopCloser(LoopClosureConfig(query_keyframes=3), MatchingConfig())
    points = closer._query(11, way)
    assert points[:, 0].min() == pytest.approx(-1.2, abs=0.06)
    assert points[:, 0].max() == pytest.approx(1.0, abs=0.06)
    assert (points[:, 1] == 2.0).all()
    assert 22 <= len(points) <= 24
    rng = np.random.default_rng(0)
    many = Keyframe(0, rng.uniform(-20.0, 20.0, (9000, 2)), Pose2(), np.eye(3), np.zeros(2))
    points = closer._query(0, [many])
    assert np.hypot(*points.T).max() < 12.0
    assert 230 <= len(points) <= 250
