# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""World files: identities of the paper's room, round trips, one line per mistake."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.config import SimulationConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import (
    load_world,
    save_world,
    shipped_worlds,
    world_from_yaml,
    world_to_yaml,
)
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.polygons import contains, is_simple, signed_area_m2
from slarm_graph.world import WorldMap
from slarm_graph.world_from_map import merged_rectangles, world_from_map

HEAD = "name: w\nceiling_m: 3.0\nboundary_m: [[0, 0], [6, 0], [6, 4], [0, 4]]\n"
START = "start: {x_m: 1.0, y_m: 1.0}\n"


def equal(one: WorldMap, other: WorldMap) -> None:
    assert (one.name, one.ceiling_m, one.access_points) == (
        other.name,
        other.ceiling_m,
        other.access_points,
    )
    np.testing.assert_allclose(one.start.as_array(), other.start.as_array(), atol=1e-12)
    np.testing.assert_array_equal(one.boundary_m, other.boundary_m)
    for a, b in zip(one.solids, other.solids, strict=True):
        assert (a.name, a.height_m) == (b.name, b.height_m)
        np.testing.assert_array_equal(a.corners_m, b.corners_m)


def test_the_papers_room() -> None:
    room = load_world("paper_room")
    assert room.extent_m() == (-5.0, 5.0, -3.5, 3.5)
    assert room.ceiling_m == 3.0
    assert [(a.x_m, a.y_m, a.z_m) for a in room.access_points] == [(0.0, 3.5, 2.5)]
    walls = [s for s in room.solids if s.name.startswith("inner wall")]
    boxes = [s for s in room.solids if s.name.startswith("box")]
    corners = np.concatenate([w.corners_m for w in walls])
    width, depth = np.ptp(corners, axis=0)
    assert (width, depth) == (7.0, 3.5)
    assert 2 * (width + depth) == 21.0
    assert sum(signed_area_m2(w.corners_m) for w in walls) == pytest.approx(7 * 3.5 - 6 * 2.5)
    assert {w.height_m for w in walls} == {1.8}
    assert len(boxes) == 3
    for box in boxes:
        assert sorted(np.ptp(box.corners_m, axis=0)) == pytest.approx([1.0, 1.3])
        assert box.height_m == 1.5


def test_at_least_half_a_metre_stays_open_beside_each_box() -> None:
    room = load_world("paper_room")
    outer = np.array([3.5, 1.75])
    gaps = []
    for box in (s for s in room.solids if s.name.startswith("box")):
        low, high = box.corners_m.min(axis=0), box.corners_m.max(axis=0)
        to_walls = np.concatenate([low - [-5.0, -3.5], [5.0, 3.5] - high])
        assert np.isclose(to_walls, 0.0).sum() == 1, "flush to one wall"
        gaps.append(np.linalg.norm(np.maximum(0.0, np.maximum(low - outer, -outer - high))))
    assert sorted(gaps) == pytest.approx([0.5, 0.75, 0.75])


@pytest.mark.parametrize("name", shipped_worlds())
def test_shipped_worlds_are_sound(name: str) -> None:
    world = load_world(name)
    assert world.name == name
    assert world.access_points
    SimulatedWorld(world, SimulationConfig(), np.random.default_rng(0)).read()
    x_min, x_max, y_min, y_max = world.extent_m()
    for solid in world.solids:
        assert is_simple(solid.corners_m)
        assert signed_area_m2(solid.corners_m) > 0
        assert 0.2 < solid.height_m <= world.ceiling_m, "seen by the laser, below the ceiling"
        assert solid.corners_m[:, 0].min() > x_min - 0.2
        assert solid.corners_m[:, 0].max() < x_max + 0.2
        assert solid.corners_m[:, 1].min() > y_min - 0.2
        assert solid.corners_m[:, 1].max() < y_max + 0.2
    assert len({s.name for s in world.solids}) == len(world.solids)


def test_at_least_six_worlds_beside_the_papers() -> None:
    assert len(shipped_worlds()) >= 7


@pytest.mark.parametrize("name", shipped_worlds())
def test_round_trip(name: str, tmp_path: Path) -> None:
    world = load_world(name)
    save_world(world, tmp_path / "copy.yaml")
    equal(load_world(tmp_path / "copy.yaml"), world)


def test_round_trip_of_random_worlds() -> None:
    for seed in range(5):
        world = random_world(np.random.default_rng(seed))
        equal(world_from_yaml(world_to_yaml(world)), world)


def test_walls_are_mitred_and_keep_their_thickness() -> None:
    world = world_from_yaml(
        HEAD + START + "walls: [{line_m: [[2, 1], [4, 1], [4, 3]], thickness_m: 0.2, height_m: 2}]"
    )
    first, second = world.solids
    assert (first.name, second.name) == ("wall 1", "wall 2")
    assert {tuple(c) for c in np.round(first.corners_m, 9)} == {
        (2.0, 0.9),
        (4.1, 0.9),
        (3.9, 1.1),
        (2.0, 1.1),
    }
    assert signed_area_m2(first.corners_m) + signed_area_m2(second.corners_m) == pytest.approx(0.8)


@pytest.mark.parametrize("heading_deg", [None, 0.0, 30.0])
@pytest.mark.parametrize("thickness_m", [0.1, 0.4, 0.74])
def test_a_rectangle_of_walls_covers_the_outer_without_the_inner(
    thickness_m: float, heading_deg: float | None
) -> None:
    """Cell by cell; half as thick as the short side nothing is left inside."""
    wall = "center_m: [3, 2], size_m: [2.5, 1.5], height_m: 2"
    wall += "" if heading_deg is None else f", heading_deg: {heading_deg}"
    world = world_from_yaml(f"{HEAD}{START}walls: [{{{wall}, thickness_m: {thickness_m}}}]")
    points = np.stack(np.meshgrid(np.arange(1.005, 5, 0.03), np.arange(0.505, 4, 0.03)), axis=-1)
    away = np.abs(Pose2(3.0, 2.0, math.radians(heading_deg or 0.0)).inverse().transform(
        points.reshape(-1, 2)))  # fmt: skip
    half = np.array([1.25, 0.75])
    expected = (away < half).all(axis=1) & ~(away < half - thickness_m).all(axis=1)
    covered = np.any([contains(s.corners_m, points.reshape(-1, 2)) for s in world.solids], axis=0)
    np.testing.assert_array_equal(covered, expected)
    for thick_m in (0.75, 0.76):
        with pytest.raises(BadInput, match="leaves no inside; use a box"):
            world_from_yaml(f"{HEAD}{START}walls: [{{{wall}, thickness_m: {thick_m}}}]")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("- 1\n", "a world is a mapping"),
        (": :\n  - [", "cannot be read as YAML"),
        (HEAD, "start: is missing"),
        (HEAD + START + "boxs: []\n", "boxs: unknown key; `slarm worlds --template`"),
        (HEAD + "start: 3\n", "start: Input should be keys and values"),
        (HEAD + START + "boxes: 3\n", "boxes: Input should be a list"),
        (HEAD + "start: {x_m: a, y_m: 1}\n", "start.x_m: Input should be a valid number"),
        (HEAD + "start: {x_m: .nan, y_m: 1}\n", "start.x_m: .*finite"),
        (
            HEAD + START + "boxes: [{center_m: [1, 1], size_m: [1, 0], height_m: 1}]",
            "boxes.0.size_m",
        ),
        (HEAD + START + "boxes: [{center_m: [1, 1], size_m: [1, 1]}]", "boxes.0.height_m"),
        (HEAD + START + "walls: [{thickness_m: 1, height_m: 1}]", "walls.0: .*line_m, or center_m"),
        (
            HEAD + START + "walls: [{line_m: [[0, 0]], thickness_m: 1, height_m: 1}]",
            "walls.0: .*at least 2 points",
        ),
        (
            HEAD
            + START
            + "polygons: [{name: p, corners_m: [[0,0],[1,1],[1,0],[0,2]], height_m: 1}]",
            "p: the polygon crosses itself",
        ),
        (
            HEAD + START + "access_points: [{name: a, x_m: 0, y_m: 0, z_m: 1},"
            " {name: a, x_m: 0, y_m: 0, z_m: 1}]",
            "the name 'a' is used twice",
        ),
    ],
)
def test_mistakes_name_the_file_and_the_key(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(BadInput, match=expected) as caught:
        load_world(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_lists_the_shipped_worlds() -> None:
    with pytest.raises(BadInput, match="paper_room"):
        load_world("no_such_world")


def test_rectangles_cover_exactly_the_cells() -> None:
    rng = np.random.default_rng(0)
    for share in (0.0, 0.2, 0.6, 1.0):
        mask = rng.random((23, 31)) < share
        painted = np.zeros(mask.shape, dtype=int)
        for first_row, first_col, last_row, last_col in merged_rectangles(mask):
            painted[first_row:last_row, first_col:last_col] += 1
        np.testing.assert_array_equal(painted, mask.astype(int))


def test_a_map_becomes_a_world() -> None:
    probability = np.full((20, 30), np.nan, dtype=np.float32)
    probability[2:18, 3:27] = 0.0
    probability[8:10, 10:15] = 1.0
    grid = OccupancyGrid(GridGeometry(-1.0, -2.0, 0.25, 20, 30), probability)
    world = world_from_map(grid)
    free = np.zeros(grid.geometry.shape, dtype=bool)
    robot = SimulatedWorld(world, SimulationConfig(), np.random.default_rng(0))
    assert robot.collisions() == 0
    area = sum(signed_area_m2(s.corners_m) for s in world.solids)
    x_min, x_max, y_min, y_max = world.extent_m()
    inside = (x_max - x_min) * (y_max - y_min)
    assert inside - area == pytest.approx(0.25**2 * grid.free.sum())
    assert free.shape == grid.geometry.shape


def test_a_map_without_free_cells_is_refused() -> None:
    unknown = np.full((4, 4), np.nan, dtype=np.float32)
    with pytest.raises(BadInput, match="no free cell"):
        world_from_map(OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 4, 4), unknown))
