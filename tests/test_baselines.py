# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The sweeps that others are compared with, by their rules; and what a disc passes over."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.config import DrivingConfig, ExploreConfig, Stage
from slarm_graph.exploration.baselines import (
    BaStar,
    Boustrophedon,
    _backtracking_points,
    _OnTiles,
    _sweep_north_south,
    _TiledFloor,
)
from slarm_graph.exploration.coverage_grid import (
    BLOCKED,
    OPEN,
    VISITED,
    CoverageGrid,
    coverage_grid,
    driving_grid,
    known_coverage,
)
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.live_map import _densified, _forbidden, mark_swept
from slarm_graph.exploration.searches import reachable
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, Mask


@pytest.mark.parametrize("seed", range(10))
def test_a_sweep_goes_north_south_east_west_and_a_way_back_leads_to_where_another_begins(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((9, 11)) > 0.2
    free[4, 5] = True
    coverage = known_coverage(free)
    codes = coverage.codes.copy()
    codes[free & (rng.random(free.shape) < 0.2)] = VISITED

    def code(row: int, col: int) -> int:
        inside = 0 <= row < codes.shape[0] and 0 <= col < codes.shape[1]
        return int(codes[row, col]) if inside else BLOCKED

    found = _sweep_north_south(codes.copy(), coverage.moves, 4 * 11 + 5)
    here, walk = (4, 5), [4 * 11 + 5]
    codes[here] = VISITED
    while True:
        around = [(here[0] + r, here[1] + c) for r, c in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        onward = [cell for cell in around if code(*cell) == OPEN]
        if not onward:
            break
        here = onward[0]
        codes[here] = VISITED
        walk.append(here[0] * 11 + here[1])
    assert found.tolist() == walk
    back = _backtracking_points(codes)
    for row, col in np.ndindex(codes.shape):
        # s1 to s8, counter-clockwise from east, by number.
        steps = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
        s = [False, *(code(row + r, col + c) == OPEN for r, c in steps)]
        pairs = [(1, 8), (1, 2), (5, 6), (5, 4), (7, 6), (7, 8)]
        wanted = codes[row, col] == VISITED and any(s[a] and not s[b] for a, b in pairs)
        assert back[row, col] == wanted


def place(free: Mask, swept: Mask) -> CoverageGrid:
    """A place of cells of 0.05 m, all of which the robot's centre may enter that is free."""
    geometry = GridGeometry(0.0, 0.0, 0.05, *free.shape)
    driving = driving_grid(geometry, free, ~free, free, swept)
    return coverage_grid(geometry, driving, np.zeros_like(free))


@pytest.mark.parametrize("kind", [BaStar, Boustrophedon])
def test_everything_that_can_be_reached_is_swept_tile_by_tile(kind: type[_OnTiles]) -> None:
    """By a robot that is where it is told to go at once; what lies behind walls is left."""
    free = np.ones((49, 70), dtype=np.bool_)
    free[20:30, 20:30] = free[:35, 45:49] = False
    free[:, 62:64] = False
    explorer, pose = kind(Stage(), DrivingConfig(robot_radius_m=0.18)), Pose2(0.4, 0.4, 0.0)
    swept, driven_m = np.zeros_like(free), 0.0
    for _ in range(200):
        goal = explorer.next_goal(place(free, swept), pose)
        if isinstance(goal, Finished):
            break
        np.testing.assert_allclose(goal.points_m[0], [pose.x, pose.y])
        cells = np.floor(_densified(goal.points_m, 0.01) / 0.05 - 1e-9).astype(int)
        assert free[cells[:, 1], cells[:, 0]].all()
        mark_swept(swept, goal.points_m / 0.05, 0.18 / 0.05)
        driven_m += float(np.hypot(*np.diff(goal.points_m, axis=0).T).sum())
        pose = Pose2(*goal.points_m[-1], 0.0)
    assert isinstance(goal, Finished)
    assert goal.reason == "no reachable tile is left"
    inside = free & reachable(place(free, swept).moves, (8, 8))
    assert swept[inside].mean() > 0.97
    assert not swept[:, 66:].any()
    assert driven_m < 2.5 * inside.sum() * 0.05**2 / 0.34


@pytest.mark.parametrize("kind", [BaStar, Boustrophedon])
def test_a_leg_sweeps_sixty_tiles_from_the_first_open_one_which_counts(
    kind: type[_OnTiles],
) -> None:
    """Along a corridor one tile wide and seventy long, of which three are swept."""
    free = np.ones((7, 70 * 7), dtype=np.bool_)
    swept = np.zeros_like(free)
    swept[:, : 3 * 7] = True
    explorer = kind(Stage(), DrivingConfig(robot_radius_m=0.185))
    leg = explorer.next_goal(place(free, swept), Pose2(0.175, 0.175, 0.0))
    assert isinstance(leg, Leg)
    assert leg.more
    assert leg.points_m[-1] == pytest.approx([(3 + 60 - 0.5) * 0.35, 0.175])
    assert explorer._tiles.attempts is not None
    assert np.argwhere(explorer._tiles.attempts).tolist() == [[0, 3]]
    assert explorer._tiles.attempts[0, 3] == 1


def test_tiles_are_as_wide_as_the_body_and_covered_by_seven_tenths() -> None:
    free = np.ones((14, 21), dtype=np.bool_)
    free[0:7, 7:10] = False
    swept = np.zeros_like(free)
    swept[:7, :5] = True  # 35 of 49, 0.71
    swept[:7, 10:12] = True  # 14 of the 28 that are free
    swept[7:, :4] = True  # 28 of 49
    swept[7:, 14:] = swept[7:, 7:12] = True
    floor = _TiledFloor(0.185)
    tiles = floor.around(place(free, swept), Pose2(0.1, 0.1, 0.0))
    assert tiles is not None
    assert tiles.fineness == 7
    expected = [[VISITED, OPEN, OPEN], [OPEN, VISITED, VISITED]]
    assert tiles.codes.tolist() == expected
    assert floor.attempts is not None
    floor.attempts[0, 1], floor.attempts[0, 2] = 4, 3
    tiles = floor.around(place(free, swept), Pose2(0.1, 0.1, 0.0))
    assert tiles is not None
    assert tiles.codes.tolist() == [[VISITED, VISITED, OPEN], expected[1]]
    walled = free.copy()
    walled[:, 12:14] = False
    tiles = floor.around(place(walled, swept), Pose2(0.1, 0.1, 0.0))
    assert tiles is not None
    assert tiles.codes[:, 2].tolist() == [BLOCKED, BLOCKED]


@pytest.mark.parametrize("seed", range(8))
def test_a_disc_sweeps_the_cells_whose_middle_it_passes_over(seed: int) -> None:
    """Brute force over a dense path, which may pass outside; what is swept stays so."""
    rng = np.random.default_rng(seed)
    path, radius = rng.uniform(-3.0, 25.0, (4, 2)), rng.uniform(0.3, 4.0)
    swept = rng.random((18, 22)) < 0.05
    before = swept.copy()
    mark_swept(swept, path, radius)
    centers = np.stack(np.meshgrid(np.arange(22) + 0.5, np.arange(18) + 0.5), axis=-1)
    dense = _densified(path, 0.5)
    away = np.linalg.norm(centers[:, :, None] - dense, axis=-1).min(axis=2)
    np.testing.assert_array_equal(swept, before | (away <= radius))


def test_points_along_a_way_are_no_farther_apart_than_asked_for() -> None:
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.35]])
    dense = _densified(corners, 0.25)
    apart = np.hypot(*np.diff(dense, axis=0).T)
    np.testing.assert_allclose(apart, [0.25] * 4 + [0.0] + [0.175] * 2, atol=1e-12)
    for corner in corners:
        assert (np.abs(dense - corner).max(axis=1) < 1e-12).any()
    np.testing.assert_array_equal(_densified(corners[:1], 0.25), corners[:1])


def test_rough_boundary_area_and_keep_out_rule_cells_out() -> None:
    """The boundary shrinks by half the error of positions, what the user drew does not."""
    geometry = GridGeometry(-0.5, -0.5, 0.1, 60, 60)
    triangle = ((1.0, 1.0), (3.0, 1.0), (1.0, 3.0))
    config = ExploreConfig(keep_out=(triangle,), area=(0.25, 9.0, -9.0, 3.75))
    out = _forbidden(geometry, (0.0, 4.0, 0.0, 5.0), config, 0.4)
    for row, col in np.ndindex(out.shape):
        x, y = geometry.center_of(np.array([row, col]))
        inside = 0.2 <= x <= 3.8 and 0.2 <= y <= 4.8 and x >= 0.25 and y <= 3.75
        slope = x + y - 4.0
        if abs(slope) < 1e-6 or min(abs(x - 1.0), abs(y - 1.0)) < 1e-6:
            continue
        in_triangle = x > 1.0 and y > 1.0 and slope < 0.0
        assert out[row, col] == (not inside or in_triangle)
    plain = _forbidden(geometry, (0.0, 4.0, 0.0, 5.0), ExploreConfig(), 0.0)
    assert (~plain).sum() == 40 * 50
