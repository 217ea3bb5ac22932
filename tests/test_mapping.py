# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Hit and visit counts against a plain Bresenham, growth, deskew, and grid axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slarm_graph.config import MappingConfig
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.mapping import GridMapper, Rendering, end_points_m, pose_rates, render
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

CONFIG = MappingConfig()


def scan_of(ranges: list[float], **fields: object) -> LaserScan:
    values: dict[str, object] = {
        "angle_min_rad": -math.pi / 2,
        "angle_increment_rad": math.pi / 180,
        "range_min_m": 0.1,
        "range_max_m": 20.0,
    }
    return LaserScan(np.array(ranges, dtype=np.float32), **(values | fields))  # type: ignore[arg-type]


def test_one_beam_clears_its_way_and_hits_its_end() -> None:
    mapper = GridMapper(CONFIG)
    mapper.add(scan_of([1.0], angle_min_rad=0.0), np.array([0.025, 0.025, 0.0]))
    grid = mapper.grid()
    assert grid.geometry.shape == (1, 21)
    assert np.flatnonzero(grid.occupied[0]).tolist() == [20]
    assert grid.free[0, :20].all()


@settings(deadline=None)
@given(st.floats(0.2, 19.0), st.floats(-3.1, 3.1), st.integers(-99, 99), st.integers(-99, 99))
def test_a_beam_is_bresenhams_line(length: float, theta: float, col: int, row: int) -> None:
    scan = scan_of([length], angle_min_rad=0.0)
    pose = Pose2(0.05 * col + 0.0137, 0.05 * row + 0.0137, theta)
    mapper = GridMapper(CONFIG)
    mapper.add(scan, pose.as_array())
    grid = mapper.grid()
    cells = np.argwhere(~np.isnan(grid.probability))
    start = grid.geometry.cell_of([pose.x, pose.y])
    end = grid.geometry.cell_of(pose.transform(scan.points_m())[0])
    step = end - start
    major = int(np.argmax(np.abs(step)))
    assert len(cells) == np.abs(step).max() + 1
    assert len(np.unique(cells[:, major])) == len(cells)
    assert cells[:, major].min() == min(start[major], end[major])
    if step[major]:
        ideal = start[1 - major] + (cells[:, major] - start[major]) * step[1 - major] / step[major]
        assert np.abs(cells[:, 1 - major] - ideal).max() <= 0.5
    assert grid.occupied[tuple(end)]
    assert grid.occupied.sum() == 1


def test_the_probability_is_the_share_of_hits() -> None:
    mapper = GridMapper(CONFIG)
    for length in (1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0):
        mapper.add(scan_of([length], angle_min_rad=0.0), np.array([0.025, 0.025, 0.0]))
    grid = mapper.grid()
    assert grid.probability[0, 20] == pytest.approx(2 / 8)
    assert grid.probability[0, 40] == 1.0
    assert grid.occupied[0, 20]


def test_ranges_say_what_rep_117_says() -> None:
    say = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan, "far": 25.0, "near": 0.05}
    grids = {}
    for name, value in say.items():
        mapper = GridMapper(CONFIG)
        mapper.add(scan_of([value], angle_min_rad=0.0), np.zeros(3))
        grids[name] = mapper.grid()
    assert grids["inf"].free.sum() == 401
    assert not grids["inf"].occupied.any()
    for name in ("-inf", "nan", "far", "near"):
        assert grids[name].unknown.all(), name


def test_beams_beyond_the_usable_range_clear_without_a_hit() -> None:
    mapper = GridMapper(MappingConfig(max_range_m=5.0))
    mapper.add(scan_of([8.0], angle_min_rad=0.0), np.zeros(3))
    assert mapper.grid().geometry.cols == 101
    assert not mapper.grid().occupied.any()


def test_growing_gives_the_same_map_as_starting_large() -> None:
    rng = np.random.default_rng(0)
    scans = [scan_of(rng.uniform(1, 15, 180).tolist()) for _ in range(40)]
    poses = np.column_stack([rng.uniform(-40, 40, (40, 2)), rng.uniform(-3, 3, 40)])
    path = Trajectory(np.arange(40) * 10**10, poses)
    grown = render(scans, path, CONFIG)
    order = np.argsort(-np.abs(poses[:, 0]))
    shuffled = Trajectory(np.arange(40) * 10**10, poses[order])
    again = render([scans[k] for k in order], shuffled, CONFIG)
    assert grown.geometry.shape == again.geometry.shape
    np.testing.assert_array_equal(grown.occupied, again.occupied)


def test_a_map_that_grows_too_large_is_refused() -> None:
    mapper = GridMapper(MappingConfig(max_cells=1000))
    with pytest.raises(BadInput, match=r"mapping\.max_cells"):
        mapper.add(scan_of([10.0] * 180), np.zeros(3))


def test_a_map_that_would_be_too_large_is_drawn_in_coarser_cells(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Scans far from each other, as where a trajectory is wrong: nothing is refused after SLAM."""
    scans = [scan_of([10.0] * 180)] * 2
    path = Trajectory(np.array([0, 10**10]), np.array([[0.0, 0.0, 0.0], [300.0, 200.0, 1.0]]))
    whole = render(scans, path, MappingConfig(resolution_m=0.1))
    assert not caplog.records
    few = render(scans, path, MappingConfig(resolution_m=0.1, max_cells=1_000_000))
    assert "mapping.max_cells" in caplog.text
    assert few.geometry.resolution_m == pytest.approx(0.3)
    assert few.geometry.rows * few.geometry.cols <= 1_000_000
    for low, high in zip(few.geometry.extent_m, whole.geometry.extent_m, strict=True):
        assert low == pytest.approx(high, abs=0.31)
    assert few.occupied.any()


def test_motion_within_the_scan_is_undone() -> None:
    """A wall seen while turning is straight once every beam has its own pose."""
    beams, period_s = 180, 0.1
    increment_s, turn_rate = period_s / beams, 2.0
    heading = turn_rate * increment_s * np.arange(beams)
    angles = -math.pi / 3 + np.radians(2 / 3) * np.arange(beams)
    ranges = 2.0 / np.cos(angles + heading)
    usable = np.abs(angles + heading) < 1.2
    scan = scan_of(
        np.where(usable, ranges, np.nan).tolist(),
        angle_min_rad=-math.pi / 3,
        angle_increment_rad=math.radians(2 / 3),
        time_increment_s=increment_s,
    )
    period_ns = round(period_s * 1e9)
    path = Trajectory([0, period_ns], [[0, 0, 0], [0, 0, turn_rate * period_s]])
    nothing = scan_of([math.nan])
    points = end_points_m([scan, nothing], path, CONFIG)
    assert len(points) == usable.sum()
    np.testing.assert_allclose(points[:, 0], 2.0, atol=1e-6)


def test_the_grid_knows_its_axes() -> None:
    geometry = GridGeometry(-1.0, 2.0, 0.5, rows=4, cols=6)
    assert geometry.extent_m == (-1.0, 2.0, 2.0, 4.0)
    assert geometry.cell_of([-0.9, 2.1]).tolist() == [0, 0]
    assert geometry.cell_of([1.9, 2.1]).tolist() == [0, 5]
    np.testing.assert_array_equal(geometry.cell_of(geometry.centers())[3, 5], [3, 5])
    assert geometry.sample(np.ones((4, 6)), [[0.0, 3.0], [9.0, 9.0]], -1.0).tolist() == [1.0, -1.0]


def test_covering_uses_whole_cells_even_where_they_stick_out() -> None:
    geometry = GridGeometry.covering(-5.0, 5.0, -3.5, 3.5, 0.15)
    assert geometry.shape == (47, 67)
    assert GridGeometry.covering(-5.0, 5.0, -3.5, 3.5, 0.1).shape == (70, 100)


def test_cells_are_free_occupied_or_unknown() -> None:
    geometry = GridGeometry(0.0, 0.0, 1.0, 1, 4)
    p = np.array([[0.1, 0.5, 0.9, np.nan]], dtype=np.float32)
    grid = OccupancyGrid(geometry, p)
    assert grid.free.tolist() == [[True, False, False, False]]
    assert grid.occupied.tolist() == [[False, False, True, False]]
    assert grid.unknown.tolist() == [[False, True, False, True]]


def test_a_rendering_is_the_map_of_the_latest_poses_however_it_came_about(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Oracle: all scans drawn at once. Few poses change, then all, then none, then some."""
    rng, count = np.random.default_rng(4), 40
    scans = [
        LaserScan(rng.uniform(0.5, 6.0, 90), -np.pi, np.pi / 45, 0.1, 8.0, Pose2(0.1, 0.0, 0.2), dt)
        for dt in rng.choice([0.0, 1e-3], count)
    ]
    stamps, config = np.arange(count) * 10**8, MappingConfig()
    geometry = GridGeometry(-4.0, -3.0, 0.07, 90, 120)
    poses = rng.normal(0.0, 0.5, (count, 3))
    drawn: list[int] = []
    add = GridMapper.add

    def counted(self: GridMapper, scan: LaserScan, *pose: Any, times: int = 1) -> None:
        drawn.append(times)
        add(self, scan, *pose, times=times)

    rendering = Rendering(GridMapper(config, geometry))
    for scan, pose in zip(scans[:30], poses, strict=False):
        rendering.add(scan, pose, np.zeros(3))
    steps = [(slice(0, 40), 1), (slice(2, 5), 1), (slice(0, 0), 1), (slice(9, 12), 3)]
    for moved, every in steps:
        poses[moved] += rng.normal(0.0, 0.2, poses[moved].shape)
        trajectory = Trajectory(stamps, poses)
        with monkeypatch.context() as watched:
            watched.setattr(GridMapper, "add", counted)
            drawn.clear()
            rendering.follow(scans, trajectory, every)
        fresh, rates = GridMapper(config, geometry), pose_rates(trajectory)
        for i in range(0, count, every):
            fresh.add(scans[i], poses[i], rates[i])
        assert np.array_equal(rendering.mapper.occupied(), fresh.occupied())
        assert np.array_equal(rendering.mapper.free(), fresh.free())
        if moved == slice(2, 5):
            assert sum(times < 0 for times in drawn) == len(drawn) // 2 < 6
        if moved == slice(0, 0):
            assert not drawn


def test_beams_are_cut_where_they_leave_given_cells() -> None:
    """Oracle: the same scan on cells that grow, looked up inside."""
    rng = np.random.default_rng(1)
    scan = LaserScan(rng.uniform(1.0, 6.0, 180), -np.pi, np.pi / 90, 0.1, 8.0)
    pose, cells = np.array([0.31, 0.22, 0.5]), GridGeometry(-1.0, -1.5, 0.05, 60, 50)
    grown, cut = GridMapper(MappingConfig()), GridMapper(MappingConfig(), cells)
    grown.add(scan, pose)
    cut.add(scan, pose)
    whole = grown.grid()
    assert np.array_equal(cut.free(), whole.geometry.resample(whole.free, cells, outside=False))
    occupied = whole.geometry.resample(whole.occupied, cells, outside=False)
    assert np.array_equal(cut.occupied(), occupied)
    assert np.array_equal(cut.occupied((slice(3, 9), slice(20, 50))), occupied[3:9, 20:50])


def test_rates_are_those_of_the_way_to_the_next_pose_and_the_last_goes_on() -> None:
    """Brute force, one pose at a time; a body at constant velocity has one rate throughout."""
    rng = np.random.default_rng(2)
    stamps = np.cumsum(rng.integers(5e7, 2e8, 20)).astype(np.int64)
    velocity = np.array([0.4, -0.2, 2.5])
    poses = (stamps - stamps[0])[:, None] * 1e-9 * velocity
    poses[:, 2] = (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    assert np.allclose(pose_rates(Trajectory(stamps, poses)), velocity)
    gap = stamps + np.where(np.arange(20) > 9, 10**11, 0)
    rates = pose_rates(Trajectory(gap, poses))
    assert np.allclose(np.delete(rates, 9, axis=0), velocity)
    assert not rates[9].any()
    assert not pose_rates(Trajectory(stamps[:1], poses[:1])).any()
