# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Ambiguous scans are matched again once later scans are known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backends.ambiguous_scans import relocated_scans
from slarm_graph.backends.gmapping import _State
from slarm_graph.backends.graph_building import ClosedGraph, GraphBuilder
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.config import FrontendConfig, GmappingConfig, PoseGraphConfig
from slarm_graph.frontends.scans import submap_matching
from slarm_graph.frontends.scans.matcher import MatchResult
from slarm_graph.frontends.scans.submaps import Keyframe
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.geometry import Floats, Pose2, between, compose

STEP_M = 0.5
SCANS = 60
NICHES_M = (2.0, 7.5, 13.0, 20.0, 27.5)


def corridor() -> Floats:
    """Points (P, 2) every 3 cm of a corridor, 2 m wide, with a niche here and there."""
    x = np.arange(-8.0, 40.0, 0.03)
    deep = np.zeros_like(x)
    for at in NICHES_M:
        deep[(x > at) & (x < at + 0.9)] = 0.4
    sides = np.column_stack([x, 1.0 + deep]), np.column_stack([x, np.full_like(x, -1.0)])
    jambs = [
        np.column_stack([np.full(13, edge), np.linspace(1.0, 1.4, 13)])
        for at in NICHES_M
        for edge in (at, at + 0.9)
    ]
    return np.concatenate([*sides, *jambs])


def seen(pose: Floats) -> Floats:
    """Points within 6 m, in beam order."""
    points = between(pose, np.column_stack([corridor(), np.zeros(len(corridor()))]))[:, :2]
    points = points[np.hypot(*points.T) < 6.0]
    return np.ascontiguousarray(points[np.argsort(np.arctan2(points[:, 1], points[:, 0]))])


def tracked(scan: int, pose: Floats, estimate: Floats, **other: object) -> TrackedScan:
    place, sure = Pose2.from_array(estimate), np.diag([1e-4, 1e-4, 1e-5])
    match = MatchResult(place, sure, 0.9, 300, 5, "")
    kept = {"odom_from_robot": None, "is_keyframe": True, **other}
    return TrackedScan(scan * 10**9, seen(pose), place, Pose2(STEP_M), sure, match, **kept)


def built(misplaced: dict[int, Floats], *, is_ambiguous: bool = True) -> tuple[Floats, ClosedGraph]:
    """True poses (S, 3), and the graph of scans of which the tracker placed some elsewhere."""
    true = np.zeros((SCANS, 3))
    true[:, 0] = STEP_M * np.arange(SCANS)
    builder = GraphBuilder(PoseGraphConfig(), FrontendConfig())
    for k, pose in enumerate(true):
        here = misplaced.get(k, pose)
        builder.add_scan(
            tracked(k, pose, here, is_keyframe=k not in misplaced, is_ambiguous=is_ambiguous)
        )
    return true, builder.close_loops()


@pytest.mark.parametrize("off_m", [-0.2, 0.15])
def test_a_misplaced_scan_is_relocated(off_m: float) -> None:
    off = {k: np.array([STEP_M * k + off_m, 0.0, 0.0]) for k in (3, 16, 41)}
    true, closed = built(off)
    assert np.abs(closed.poses - true)[:, :2].max() < 0.03
    assert np.flatnonzero(closed.relocations.any(axis=1)).tolist() == list(off)


def test_an_unambiguous_scan_stays() -> None:
    true, closed = built({16: np.array([STEP_M * 16 + 0.2, 0.0, 0.0])}, is_ambiguous=False)
    assert closed.poses[16, 0] - true[16, 0] == pytest.approx(0.2, abs=0.02)
    assert not closed.relocations.any()


def test_a_scan_stays_where_it_fits_best() -> None:
    """Started on its place it does not get worse."""
    true, closed = built({16: np.array([STEP_M * 16, 0.0, 0.0])})
    assert np.abs(closed.poses - true)[:, :2].max() < 0.03


def test_a_relocation_has_a_notice_and_a_covariance() -> None:
    """A scan with niches in view is well constrained along the corridor."""
    off = {16: np.array([STEP_M * 16 + 0.2, 0.0, 0.0])}
    _, closed = built(off)
    (notice,) = [n for n in closed.notices if "ambiguous" in n]
    assert notice.startswith("1 ambiguous scan matched again")
    assert f"up to {math.hypot(*closed.relocations[16, :2]):.2f} m" in notice
    along, across, turn = np.sqrt(np.diag(closed.lag_covariances[16]))
    assert 0.0 < across < 0.01
    assert across < along < 0.05
    assert 0.0 < turn < 0.01
    assert not closed.lag_covariances[17].any()


def test_a_bare_corridor_leaves_the_position_along_it_uncertain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(globals(), "NICHES_M", (0.5,))
    _, closed = built({41: np.array([STEP_M * 41 + 0.02, 0.05, 0.0])})
    along, across, _ = np.sqrt(np.diag(closed.lag_covariances[41]))
    assert across < 0.01
    assert along > 0.1


def test_a_scan_that_fits_worse_is_not_relocated(monkeypatch: pytest.MonkeyPatch) -> None:
    def worse(grid: object, points: Floats, start: Floats, *_: object) -> tuple[object, ...]:
        return start + np.array([0.1, 0.0, 0.0]), np.eye(3), 0.3, 100, 5

    monkeypatch.setattr(submap_matching, "refine_near", worse)
    _, closed = built({16: np.array([STEP_M * 16, 0.0, 0.0])})
    assert not closed.relocations.any()
    assert not closed.lag_covariances.any()
    assert not any("another place" in n for n in closed.notices)


def test_a_scan_is_matched_to_the_submap_around_it() -> None:
    """From the tracker's estimate."""
    graph, local = SubmapGraph(PoseGraphConfig()), np.zeros((SCANS, 3))
    local[:, 0] = STEP_M * np.arange(SCANS)
    for k, pose in enumerate(local):
        if k % 2 == 0:
            graph.add(
                Keyframe(k, seen(pose), Pose2.from_array(pose), np.eye(3) * 1e-4, np.zeros(2))
            )
    asked: dict[int, float] = {}

    class Spy:
        def better_fit(self, points: Floats, submap: int, start: Floats) -> tuple[Floats, Floats]:
            anchor = graph.keyframes[graph.submaps[submap].anchor].local_from_robot
            at = (anchor @ Pose2.from_array(start)).x
            asked[round(at / STEP_M)] = abs(float(start[0]))
            return start, np.zeros((3, 3))

    scans = {k: seen(local[k]) for k in (1, 17, 33, 55)}
    relocations, _ = relocated_scans(scans, graph, Spy(), local)  # type: ignore[arg-type]
    assert list(asked) == list(scans)
    long_m = max(STEP_M * 2 * (s.last - s.first) for s in graph.submaps)
    assert all(asked[k] <= long_m for k in (1, 17, 33))
    np.testing.assert_allclose(relocations, 0.0, atol=1e-12)


def test_scans_between_updates_of_the_filter_are_relocated() -> None:
    """Those at updates stay, as their motion was used already."""
    state = _State(ScanTracker(FrontendConfig()), MappingFilter.empty(GmappingConfig()), None)
    state.local = [np.array([0.4 * k, 0.0, 0.1 * k]) for k in range(5)]
    state.updates = [0, 2, 4]
    _, closed = built({})
    relocations = np.zeros((5, 3))
    relocations[1], relocations[2] = (0.2, 0.01, 0.0), (0.3, 0.0, 0.0)
    path = state.relocated(replace(closed, relocations=relocations))
    expected = np.array(state.local)
    expected[1] = compose(expected[1], relocations[1])
    np.testing.assert_allclose(path, expected)
    np.testing.assert_array_equal(state.relocated(None), state.motion_path())
    state.closed_path = np.array(state.local)
    np.testing.assert_array_equal(
        state.relocated(replace(closed, relocations=relocations)), state.motion_path()
    )


def test_before_the_first_submap_nothing_is_relocated() -> None:
    builder = GraphBuilder(PoseGraphConfig(), FrontendConfig())
    start, off = np.zeros(3), np.array([0.1, 0.0, 0.0])
    builder.add_scan(tracked(0, start, start))
    builder.add_scan(tracked(1, start, off, is_keyframe=False, is_ambiguous=True))
    assert builder.close_loops().poses.shape == (2, 3)
