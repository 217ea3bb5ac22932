# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Access points where none can hang are told, those mounted on walls are not."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import BadInput
from slarm_graph.files.world_checks import misplaced, world_warnings
from slarm_graph.files.worlds import load_world, shipped_worlds, world_from_yaml
from slarm_graph.geographic import as_geographic
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.placement import placement_notices

HEAD = "name: w\nceiling_m: 3.0\nboundary_m: [[0, 0], [6, 0], [6, 4], [0, 4]]\n"


def room() -> OccupancyGrid:
    """4 x 4 m at 0.1 m: free, with a block of 2 x 2 m in the middle, unknown to the right."""
    p = np.zeros((40, 60), np.float32)
    p[10:30, 10:30] = 1.0
    p[:, 40:] = np.nan
    return OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 40, 60), p)


@pytest.mark.parametrize(
    ("x_m", "z_m", "height_m", "words"),
    [
        (2.0, 2.5, None, "inside an obstacle of unknown height"),
        (2.0, 1.0, 1.5, "inside an obstacle 1.5 m high"),
        (2.0, 2.5, 1.5, ""),
        (1.05, 1.0, None, ""),
        (0.5, 1.0, None, ""),
        (5.5, 1.0, None, "lies in unknown space"),
        (4.1, 1.0, None, ""),
        (9.0, 1.0, None, ""),
    ],
)
def test_where_access_points_hang(
    x_m: float, z_m: float, height_m: float | None, words: str
) -> None:
    ap = AccessPoint("AP1", x_m, 2.0, z_m)
    told = placement_notices(as_geographic(room(), height_m), [ap], 0.25)
    assert len(told) == bool(words)
    assert words in "".join(told)


def test_access_points_of_worlds() -> None:
    start = "start: {x_m: 1.0, y_m: 1.0}\n"
    box = "boxes: [{name: crate, center_m: [3, 2], size_m: [1, 1], height_m: 2}]\n"
    ap = "access_points: [{{name: a, x_m: {}, y_m: 2, z_m: {}}}]\n"
    for x_m, z_m, words in (
        (3.0, 1.0, "inside crate, which is 2 m high"),
        (1.0, 3.5, "above the ceiling"),
        (1.0, -1.0, "below the floor"),
        (9.0, 1.0, "outside the boundary"),
        (3.0, 2.5, ""),
        (0.0, 2.5, ""),
    ):
        told = world_warnings(world_from_yaml(HEAD + start + box + ap.format(x_m, z_m)))
        assert words in "".join(told)
        assert len(told) == bool(words)
    assert "no access points" in world_warnings(world_from_yaml(HEAD + start))[0]


def test_every_place_of_an_access_point_is_judged_by_what_is_there() -> None:
    """All combinations of places in, at and beyond room and crate, each judgement by itself."""
    start = "start: {x_m: 1.0, y_m: 1.0}\n"
    box = "boxes: [{name: crate, center_m: [3, 2], size_m: [1, 1], height_m: 2}]\n"
    world = world_from_yaml(HEAD + start + box)
    for x_m, y_m, z_m in product(
        (-1.0, 0.0, 1.0, 3.0, 6.0, 7.0), (-1.0, 0.0, 2.0, 4.0, 5.0), (-1.0, 0.0, 1.0, 2.0, 3.0, 4.0)
    ):
        told = " ".join(misplaced(AccessPoint("a", x_m, y_m, z_m), world))
        assert ("above the ceiling" in told) == (z_m > 3.0)
        assert ("below the floor" in told) == (z_m < 0.0)
        assert ("outside the boundary" in told) == (not (0 <= x_m <= 6 and 0 <= y_m <= 4))
        assert ("inside crate" in told) == ((x_m, y_m) == (3.0, 2.0) and z_m < 2.0)


@pytest.mark.parametrize("name", shipped_worlds())
def test_shipped_worlds_have_nothing_amiss(name: str) -> None:
    assert world_warnings(load_world(name)) == ()


def test_a_start_where_no_robot_can_be() -> None:
    box = "boxes: [{name: crate, center_m: [3, 2], size_m: [1, 1], height_m: 2}]\n"
    for place, words in (("{x_m: 3, y_m: 2}", "inside crate"), ("{x_m: 9, y_m: 2}", "outside")):
        with pytest.raises(BadInput, match=words):
            world_from_yaml(HEAD + f"start: {place}\n" + box)


def test_worlds_tell_all_their_problems_at_once() -> None:
    text = HEAD + "start: {x_m: a}\nboxes: [{center_m: [1, 1], size_m: [1, 0], height_m: 1}]\n"
    with pytest.raises(BadInput) as refused:
        world_from_yaml(text)
    for words in ("start.x_m", "start.y_m", "boxes.0.size_m"):
        assert words in str(refused.value)


def test_too_many_solids_are_refused_before_they_are_built() -> None:
    box = "{center_m: [3, 2], size_m: [1, 1], height_m: 2}"
    text = HEAD + f"start: {{x_m: 1, y_m: 1}}\nboxes: [{', '.join([box] * 5001)}]\n"
    with pytest.raises(BadInput, match="5001 solids; a world has at most 5000"):
        world_from_yaml(text)


@pytest.mark.parametrize("seed", range(20))
def test_an_access_point_in_a_block_is_told_when_nothing_free_is_near(seed: int) -> None:
    """Brute force over all cells, with one free cell somewhere around."""
    rng = np.random.default_rng(seed)
    p = np.ones((30, 30), np.float32)
    row, col = rng.integers(8, 22, 2)
    p[row, col] = 0.0
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 30, 30), p)
    x_m, y_m = rng.uniform(1.0, 2.0, 2)
    away_m = np.hypot(0.1 * col + 0.05 - x_m, 0.1 * row + 0.05 - y_m)
    ap = AccessPoint("AP1", float(x_m), float(y_m), 2.5)
    for radius_m in (0.15, 0.4, 0.8):
        told = placement_notices(as_geographic(grid, None), [ap], radius_m)
        assert len(told) == (away_m > radius_m + 0.1)
