# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The two faces of a partition are told apart where a place is matched from beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from slarm_graph.config import FrontendConfig
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    build_likelihood_grid,
    scan_segments,
)
from slarm_graph.frontends.scans.line_search import LineSearchMatch, line_search_match
from slarm_graph.frontends.scans.wall_faces import align_by_faces
from slarm_graph.frontends.scans.wall_sides import (
    WallSides,
    facing,
    own_surfaces,
    share_from_behind,
    wall_sides,
)
from slarm_graph.geometry import Floats, between

THICK_M, BEYOND = 0.12, np.array([0.0, 2.4, 0.0])
"""Of the partition, whose near face is at y = 1; from where it is seen from beyond."""
START = BEYOND - [0.0, 0.05, 0.0]


def wall(x_0: float, x_1: float, y: float) -> Floats:
    x = np.arange(x_0, x_1, 0.03)
    return np.column_stack([x, np.full_like(x, y)])


def side(x: float, y_0: float, y_1: float) -> Floats:
    return wall(y_0, y_1, x)[:, ::-1].copy()


def in_beam_order(points: Floats, pose: Floats) -> Floats:
    own = between(pose, np.column_stack([points, np.zeros(len(points))]))[:, :2]
    return np.ascontiguousarray(own[np.argsort(np.arctan2(own[:, 1], own[:, 0]))])


def walls(face_m: float) -> Floats:
    """A face of the partition with a door of 0.8 m, and the end of the room beyond."""
    corners = side(-1.5, 4.6, 5.0), side(1.5, 4.6, 5.0)
    faces = wall(-3.0, -0.4, face_m), wall(0.4, 3.0, face_m)
    return np.concatenate([*faces, wall(-1.5, 1.5, 5.0), *corners])


def seen_here() -> Floats:
    """From the origin: the near face, and what shows through the door."""
    return in_beam_order(walls(1.0), np.zeros(3))


def seen_beyond() -> Floats:
    """From beyond the door: the far face, and the same wall at the end of that room."""
    return in_beam_order(walls(1.0 + THICK_M), BEYOND)


@pytest.fixture(scope="module")
def place() -> tuple[LikelihoodGrid, WallSides]:
    here, matching = seen_here(), FrontendConfig().matching
    grid = build_likelihood_grid(
        scan_segments(here, np.zeros(3), matching.max_gap_m),
        resolution_m=matching.resolution_m,
        sigma_m=matching.sigma_m,
    )
    return grid, wall_sides([here], np.zeros((1, 3)))


def found(
    place: tuple[LikelihoodGrid, WallSides], scans: Sequence[Floats], least: int = 20
) -> tuple[LineSearchMatch, Sequence[Floats]]:
    grid, sides = place
    loosely = np.diag([1.0, 1.0, 10.0])

    def align(some: Sequence[Floats], near: Floats) -> LineSearchMatch:
        return line_search_match(grid, np.concatenate(some), near, loosely, 1.0, 20, 0.3)

    poses = np.zeros((len(scans), 3))
    seen = [own_surfaces(scan) for scan in scans]
    return align_by_faces(align, sides, scans, seen, poses, START, least)


def test_the_far_face_of_a_partition_does_not_drag_a_match_along(
    place: tuple[LikelihoodGrid, WallSides],
) -> None:
    match, (kept,) = found(place, [seen_beyond()])
    assert abs(match.pose[1] - BEYOND[1]) < 0.01
    np.testing.assert_array_equal(kept, seen_beyond()[seen_beyond()[:, 1] > 2.0])


def test_every_scan_keeps_its_own(place: tuple[LikelihoodGrid, WallSides]) -> None:
    """Two scans, of which one sees the wall at the end alone."""
    back_wall = seen_beyond()[seen_beyond()[:, 1] > 2.0]
    _, kept = found(place, [seen_beyond(), np.ascontiguousarray(back_wall)])
    assert len(kept[0]) < len(seen_beyond())
    np.testing.assert_array_equal(kept[1], back_wall)


def test_where_too_little_is_left_all_count(place: tuple[LikelihoodGrid, WallSides]) -> None:
    match, (kept,) = found(place, [seen_beyond()], least=len(seen_beyond()))
    np.testing.assert_array_equal(kept, seen_beyond())
    assert BEYOND[1] - match.pose[1] > 0.8 * THICK_M


def test_what_is_seen_from_its_own_side_stays(place: tuple[LikelihoodGrid, WallSides]) -> None:
    _, sides = place
    here, turned = seen_here(), np.array([0.0, 0.0, 0.05])
    np.testing.assert_array_equal(facing(sides, here, own_surfaces(here), np.zeros(3)), here)
    beyond = seen_beyond()
    look = own_surfaces(beyond), BEYOND - [0.0, THICK_M, 0.0]
    np.testing.assert_array_equal(facing(sides, beyond, *look), beyond[beyond[:, 1] >= 2.0])
    share = share_from_behind(sides, *look)
    assert share > 0.8
    assert share_from_behind(sides, own_surfaces(here), turned) == 0.0
