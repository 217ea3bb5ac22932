# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Old places found by search count only once the robot has seen them from a second place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from slarm_graph.config import FrontendConfig, LoopClosureConfig, SimulationConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans import loop_closure
from slarm_graph.frontends.scans.closures import Closure, ClosureCandidates
from slarm_graph.frontends.scans.loop_closure import LoopCloser
from slarm_graph.frontends.scans.submaps import Keyframe, Submap, make_submap, view_center
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import between, compose

ROUTE = np.array([[-3.0, -2.8], [4.4, -2.0]])
OLD = 12
OFF = np.array([0.6, -0.3, 0.05])


@pytest.fixture(scope="module")
def way() -> list[Keyframe]:
    """Keyframes of a drive through the paper's room, placed by the tracker."""
    source = SourceFromWorld(
        load_world("paper_room"), SimulationConfig(), seed=3, script=waypoints(ROUTE)
    )
    tracker = ScanTracker(FrontendConfig())
    tracked = [tracker.track(reading) for reading in source]
    return [
        Keyframe(k, t.points_m, t.local_from_robot, np.eye(3) * 1e-4, view_center(t.points_m))
        for k, t in enumerate(tracked)
        if t.is_keyframe
    ]


def closures(
    keyframes: Sequence[Keyframe], later: Sequence[Keyframe], submap: Submap
) -> list[Closure]:
    """Drive along `later`, not knowing well where the submap is, and collect what is found."""
    closer = LoopCloser(LoopClosureConfig(), FrontendConfig().matching)
    anchor = keyframes[submap.anchor].local_from_robot.as_array()
    met, done = list(keyframes), []
    for keyframe in later:
        met.append(keyframe)
        true = between(anchor, keyframe.local_from_robot.as_array())
        expected = ClosureCandidates(
            np.array([0]), compose(true, OFF)[None], np.array([0.4]), np.array([0.1])
        )
        done += closer.confirm(met, [submap])
        if closer.is_due(len(met) - 1):
            done += closer.examine(met, [submap], expected)
    return done


def test_a_place_seen_from_one_spot_only_closes_no_loop(way: list[Keyframe]) -> None:
    submap = make_submap(way, 0, OLD, 6)
    here = [replace(way[8], scan=100 + k) for k in range(30)]
    assert closures(way[:OLD], here, submap) == []


def test_a_place_seen_from_two_spots_closes_the_loop_where_it_is(way: list[Keyframe]) -> None:
    submap = make_submap(way, 0, OLD, 6)
    done = closures(way[:OLD], way[2:OLD], submap)
    assert len(done) >= 2
    for closure in done:
        assert closure.reason == ""
        keyframe = way[2 + closure.keyframe - OLD]
        true = between(way[6].local_from_robot.as_array(), keyframe.local_from_robot.as_array())
        miss = between(true, closure.submap_from_keyframe)
        assert np.hypot(miss[0], miss[1]) < 0.02
        assert abs(miss[2]) < 0.005


@pytest.mark.parametrize(("least", "is_told"), [(0.999, True), (0.5, False)])
def test_a_match_that_agrees_too_little_says_its_score(
    way: list[Keyframe], least: float, is_told: bool
) -> None:
    submap, met = make_submap(way, 0, OLD, 6), way[:OLD]
    settings = LoopClosureConfig(min_score=least)
    there = between(*(k.local_from_robot.as_array() for k in (met[6], met[-1])))[None]
    expected = ClosureCandidates(np.array([0]), there, np.array([0.01]), np.array([0.01]))
    (found,) = LoopCloser(settings, FrontendConfig().matching).examine(met, [submap], expected)
    assert found.reason == (f"score {found.score:.2f}" if is_told else "")


def test_searches_in_vain_may_go_on_for_ever(way: list[Keyframe]) -> None:
    """Patience grows with every one; as a power without end it left the range of floats."""
    submap = make_submap(way, 0, OLD, 6)
    nothing_alike = replace(way[-1], points_m=np.array([[3.0, 0.0], [-3.0, 0.5]]))
    config = LoopClosureConfig(search_again=1, window_m=0.1)
    closer = LoopCloser(config, FrontendConfig().matching)
    expected = ClosureCandidates(
        np.array([0]), np.zeros((1, 3)), np.array([0.01 + config.sure_m]), np.array([0.01])
    )
    met = way[:OLD]
    for _ in range(4000):
        met.extend([nothing_alike] * 70)
        assert closer.examine(met, [submap], expected) == []


@pytest.mark.parametrize(("sigma_m", "sigma_rad"), [(0.3, 0.1), (0.9, 0.02), (5.0, 2.0)])
def test_a_search_reaches_as_far_as_the_graph_may_err(
    way: list[Keyframe], monkeypatch: pytest.MonkeyPatch, sigma_m: float, sigma_rad: float
) -> None:
    """To where one in a million lies, however often in vain, and to the settings' bound."""
    reaches: list[tuple[float, float]] = []

    def nothing(*_: object, reach_m: float, reach_rad: float, **__: object) -> None:
        reaches.append((reach_m, reach_rad))

    monkeypatch.setattr(loop_closure, "search", nothing)
    settings = LoopClosureConfig(search_again=1)
    closer = LoopCloser(settings, FrontendConfig().matching)
    met = list(way[:OLD])
    sigmas = np.array([sigma_m]), np.array([sigma_rad])
    expected = ClosureCandidates(np.array([0]), np.zeros((1, 3)), *sigmas)
    for keyframe in [way[OLD], way[-1]] * 200:
        met.append(keyframe)
        closer.examine(met, [make_submap(way, 0, OLD, 6)], expected)
    one_in_a_million = np.sqrt(chi2.isf(1e-6, 3))
    assert len(reaches) > 5
    for reach_m, reach_rad in reaches:
        assert reach_m == pytest.approx(
            min(one_in_a_million * sigma_m, settings.window_m), rel=1e-3
        )
        assert reach_rad == pytest.approx(
            min(one_in_a_million * sigma_rad, settings.window_rad), rel=1e-3
        )


@pytest.mark.parametrize(
    ("off", "agrees"),
    [
        ((0.0, 0.0, 0.0), True),
        ((0.03, 0.0, 0.01), True),
        ((0.25, 0.0, 0.0), False),
        ((0.0, -0.25, 0.0), False),
        ((0.0, 0.0, -0.06), False),
    ],
)
def test_a_second_match_that_lands_elsewhere_confirms_nothing(
    way: list[Keyframe], monkeypatch: pytest.MonkeyPatch, off: tuple[float, ...], agrees: bool
) -> None:
    class Misled(LoopCloser):
        """Its second matches are off by so much."""

        second = False

        def confirm(self, *given: object) -> list[Closure]:
            self.second = True
            done = super().confirm(*given)
            self.second = False
            return done

        def _refine(self, *given: object) -> Closure:
            closure = super()._refine(*given)
            if not self.second:
                return closure
            there = compose(closure.submap_from_keyframe, np.array(off))
            return replace(closure, submap_from_keyframe=there)

    monkeypatch.setitem(globals(), "LoopCloser", Misled)
    done = closures(way[:OLD], way[2:OLD], make_submap(way, 0, OLD, 6))
    assert done
    if agrees:
        assert any(closure.reason == "" for closure in done)
    else:
        assert {closure.reason for closure in done} == {"not confirmed: a second match disagrees"}


@pytest.mark.parametrize("heading", np.linspace(0.0, np.pi, 7))
def test_a_match_along_one_wall_slides_whichever_way_the_wall_runs(heading: float) -> None:
    """The weakest direction counts, not an axis and not the strongest."""
    config = LoopClosureConfig()
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    strong, weak = 25.0 / config.max_sigma_m**2, 0.25 / config.max_sigma_m**2

    def reason(of_along: float, of_across: float) -> str:
        information = np.eye(3)
        information[:2, :2] = of_along * np.outer(along, along)
        information[:2, :2] += of_across * np.outer(across, across)
        return loop_closure.rejection_reason(1.0, information, 0.0, config)

    assert reason(strong, strong) == ""
    assert reason(weak, strong) == reason(strong, weak) == "slides along a wall"
