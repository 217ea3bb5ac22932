# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Map accuracy: identities, hand-counted cases, brute-force distances, alignment, sharpness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.spatial.distance import cdist

from slarm_graph.errors import BadInput
from slarm_graph.eval.map_accuracy import distance_to_m, map_accuracy, map_metrics
from slarm_graph.eval.map_alignment import align_maps
from slarm_graph.eval.map_difference import (
    densest_difference,
    difference_classes,
    save_difference,
)
from slarm_graph.eval.sharpness import sharpness, sharpness_metrics
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, OccupancyGrid


def room(resolution_m: float = 0.05) -> OccupancyGrid:
    """An L-shaped room with a pillar, unknown outside."""
    geometry = GridGeometry.covering(-1.0, 7.0, -1.0, 5.0, resolution_m)
    x, y = np.moveaxis(geometry.centers(), -1, 0)
    inside = (x > 0) & (x < 6) & (y > 0) & (y < 4) & ~((x > 4) & (y > 2))
    walls = (x > -0.1) & (x < 6.1) & (y > -0.1) & (y < 4.1) & ~inside & ~((x > 4.1) & (y > 2.1))
    pillar = np.hypot(x - 1.5, y - 1.2) < 0.25
    p = np.full(geometry.shape, np.nan, dtype=np.float32)
    p[inside] = 0.0
    p[walls | pillar] = 1.0
    return OccupancyGrid(geometry, p)


def moved(grid: OccupancyGrid, map_from_grid: Pose2) -> OccupancyGrid:
    geometry = GridGeometry.covering(-10, 12, -10, 12, grid.geometry.resolution_m)
    points = map_from_grid.inverse().transform(geometry.centers())
    return OccupancyGrid(geometry, grid.geometry.sample(grid.probability, points, np.nan))


def test_a_map_agrees_with_itself() -> None:
    result = map_accuracy(room(), room())
    assert (result.cell_accuracy, result.iou, result.iou_free, result.f1) == (1, 1, 1, 1)
    assert result.wall_distance_mean_m == 0.0
    assert result.known_share == 1.0
    assert not result.resampled


def test_an_all_free_map_fails_on_iou_though_most_cells_agree() -> None:
    reference = room()
    free = OccupancyGrid(reference.geometry, np.zeros_like(reference.probability))
    result = map_accuracy(reference, free)
    assert result.cell_accuracy > 0.85
    assert result.iou == result.recall == result.f1 == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_shares_are_those_counted_cell_by_cell(seed: int) -> None:
    """What the estimate does not know is neither found nor missed."""
    rng, resolution_m, tolerance_m = np.random.default_rng(seed), 0.1, 0.15
    geometry = GridGeometry(0.0, 0.0, resolution_m, 12, 15)
    a, b = (
        rng.choice(
            np.array([0.0, 1.0, np.nan], dtype=np.float32), geometry.shape, p=[0.6, 0.2, 0.2]
        )
        for _ in range(2)
    )
    result = map_accuracy(
        OccupancyGrid(geometry, a), OccupancyGrid(geometry, b), tolerance_m=tolerance_m
    )

    def share(of: np.ndarray, near: np.ndarray, judged: np.ndarray) -> float:
        cells = np.argwhere((of == 1.0) & ~np.isnan(judged))
        walls = np.argwhere(near == 1.0)
        return float((resolution_m * cdist(cells, walls).min(axis=1) <= tolerance_m).mean())

    assert result.recall == pytest.approx(share(a, b, b))
    assert result.precision == pytest.approx(share(b, a, a))


def test_counts_of_a_small_map() -> None:
    geometry = GridGeometry(0.0, 0.0, 1.0, 1, 5)
    reference = OccupancyGrid(geometry, np.array([[1, 1, 0, 0, np.nan]], dtype=np.float32))
    estimate = OccupancyGrid(geometry, np.array([[1, 0, 1, np.nan, 1]], dtype=np.float32))
    result = map_accuracy(reference, estimate, tolerance_m=0.5)
    assert result.cell_accuracy == pytest.approx(1 / 3)
    assert result.iou == pytest.approx(1 / 3)
    assert (result.precision, result.recall) == (0.5, 0.5)
    assert result.known_share == pytest.approx(3 / 4)
    assert result.wall_distance_mean_m == pytest.approx(0.5)
    assert difference_classes(reference, estimate)[0].tolist() == [2, 4, 3, 0, 0]


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_the_difference_becomes_a_figure(tmp_path: Path, kind: str) -> None:
    moved = Pose2(0.2, 0.0, 0.0)
    save_difference(path := tmp_path / f"d.{kind}", room(), room(), moved)
    assert path.stat().st_size > 2_000
    if kind == "svg":
        assert "wall only in EST" in path.read_text()


def test_the_closer_look_is_at_what_differs_and_else_at_walls(tmp_path: Path) -> None:
    one, other = room(), room()
    row, col = np.argwhere(one.free)[77]
    other.probability[row, col] = 1.0
    x, y = one.geometry.center_of(np.array([[row, col]]))[0]
    x_m, y_m, side_m = densest_difference(difference_classes(one, other), one.geometry)
    assert x_m < x < x_m + side_m
    assert y_m < y < y_m + side_m
    same = difference_classes(one, one)
    x_m, y_m, side_m = densest_difference(same, one.geometry)
    walls = one.geometry.center_of(np.argwhere(one.occupied))
    inside = (np.abs(walls - [x_m + side_m / 2, y_m + side_m / 2]) < side_m / 2).all(axis=1)
    assert inside.any()
    for estimate, words in ((one, "no cell differs"), (other, "(cells in all: 1)")):
        save_difference(path := tmp_path / "d.svg", one, estimate)
        assert words in path.read_text()


def test_distances_equal_brute_force() -> None:
    mask = np.random.default_rng(0).random((30, 40)) < 0.03
    cells = np.argwhere(np.ones_like(mask))
    brute = cdist(cells, np.argwhere(mask)).min(axis=1).reshape(mask.shape) * 0.05
    np.testing.assert_allclose(distance_to_m(mask, 0.05), brute, atol=1e-5)


def test_another_resolution_is_resampled_and_said() -> None:
    result = map_accuracy(room(0.05), room(0.1))
    assert result.resampled
    assert result.cell_accuracy > 0.97
    assert any("resampled" in metric.note for metric in map_metrics(result))


def test_a_map_of_another_place_is_not_meaningful() -> None:
    result = map_accuracy(room(), moved(room(), Pose2(6.0, 4.0, 0.0)))
    assert not result.meaningful
    assert any("not meaningful" in metric.note for metric in map_metrics(result))


def test_a_reference_without_walls_is_refused() -> None:
    grid = room()
    with pytest.raises(BadInput, match="no occupied cell"):
        map_accuracy(OccupancyGrid(grid.geometry, np.zeros_like(grid.probability)), grid)


@pytest.mark.parametrize(
    "pose", [Pose2(0.5, -0.3, 0.1), Pose2(2.0, 1.0, 2.2), Pose2(-3.0, 2.0, -1.5)]
)
def test_alignment_finds_the_motion_between_maps(pose: Pose2) -> None:
    found = align_maps(room(), moved(room(), pose))
    error = found @ pose
    assert np.hypot(error.x, error.y) < 0.03
    assert abs(error.theta) < 0.01


def test_blurred_and_doubled_walls_have_a_larger_sigma() -> None:
    rng = np.random.default_rng(1)
    along = rng.uniform(0, 10, 20000)
    crisp = np.column_stack([along, rng.normal(0, 0.01, 20000)])
    blurred = np.column_stack([along, rng.normal(0, 0.04, 20000)])
    doubled = crisp + np.array([0.0, 0.15]) * (rng.random(20000) < 0.5)[:, None]
    sigmas = [sharpness(points).wall_sigma_m for points in (crisp, blurred, doubled)]
    assert sigmas[0] == pytest.approx(0.01, rel=0.1)
    assert sigmas[1] == pytest.approx(0.04, rel=0.1)
    assert sigmas[2] == pytest.approx(0.075, rel=0.1)
    assert sharpness(crisp).entropy < sharpness(blurred).entropy


@pytest.mark.parametrize("seed", range(3))
def test_sharpness_is_that_of_every_neighbourhood(seed: int) -> None:
    """One by one, at the first point of every cell of 5 cm: entropy of all, spread of walls."""
    rng = np.random.default_rng(seed)
    wall = np.column_stack([rng.uniform(0.0, 2.0, 250), rng.normal(0.0, 0.02, 250)])
    points = np.concatenate([wall, rng.uniform(0.5, 1.5, (60, 2)), [[9.0, 9.0]]])
    first = {tuple(cell): k for k, cell in reversed([*enumerate(np.floor(points / 0.05))])}
    entropies, across_m = [], []
    for k in first.values():
        own = points[np.hypot(*(points - points[k]).T) <= 0.2]
        if len(own) >= 8:
            off = own - own.mean(axis=0)
            covariance = off.T @ off / (len(own) - 1)
            entropies.append(0.5 * np.log(np.linalg.det(2.0 * np.pi * np.e * covariance)))
            width, length = np.sqrt(np.linalg.eigvalsh(covariance))
            across_m += [width] * bool(length > 2.0 * width)
    found = sharpness(points, radius_m=0.2)
    assert found.samples == len(entropies) < len(first)
    assert found.entropy == pytest.approx(np.mean(entropies))
    assert 0 < len(across_m) < len(entropies)
    assert found.wall_sigma_m == pytest.approx(np.median(across_m))
    assert found.wall_sigma_95_m == pytest.approx(np.quantile(across_m, 0.95))
    assert sharpness(points, radius_m=0.2, samples=20).samples <= 20
    told = {m.name: (m.value, m.note) for m in sharpness_metrics(found)}
    note = f"over {found.samples} neighbourhoods of the scans' end points"
    assert told == {
        "map_entropy_nat": (found.entropy, note),
        "wall_sigma_m": (found.wall_sigma_m, note),
        "wall_sigma_95_m": (found.wall_sigma_95_m, note),
    }


def test_no_points_no_sharpness() -> None:
    assert sharpness(np.zeros((0, 2))).samples == 0


def test_the_closer_view_shows_where_most_cells_differ(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new thing in one corner: it is seen there, framed beside, and a metre is a metre."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    geometry = GridGeometry(-1.0, -2.0, 0.1, 120, 160)
    before = np.zeros(geometry.shape, dtype=np.float32)
    after = before.copy()
    after[80:90, 100:110] = 1.0
    save_difference(
        tmp_path / "d.png", OccupancyGrid(geometry, before), OccupancyGrid(geometry, after)
    )
    whole, closer = drawn[0].axes
    (low_x, high_x), (low_y, high_y) = closer.get_xlim(), closer.get_ylim()
    assert low_x <= -1.0 + 10.0
    assert high_x >= -1.0 + 11.0
    assert low_y <= -2.0 + 8.0
    assert high_y >= -2.0 + 9.0
    assert high_x - low_x == pytest.approx(high_y - low_y)
    assert high_x - low_x < 8.0
    frames = [p for p in whole.patches if isinstance(p, Rectangle) and not p.get_fill()]
    assert frames[0].get_bbox().bounds == pytest.approx(
        (low_x, low_y, high_x - low_x, high_y - low_y)
    )
    assert {axes.get_aspect() for axes in (whole, closer)} == {1.0}


@pytest.mark.parametrize("wide_m", [0.7, 2.9, 3.1, 16.0, 29.0, 250.0])
def test_the_scale_is_as_long_as_it_says_and_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wide_m: float
) -> None:
    """One, two or five of a power of ten: the longest of at most a third of the width."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    geometry = GridGeometry(3.0, -2.0, wide_m / 100, 70, 100)
    grid = OccupancyGrid(geometry, np.zeros(geometry.shape, dtype=np.float32))
    save_difference(tmp_path / "d.png", grid, grid)
    rounds_m = [n * 10.0**k for k in range(-3, 4) for n in (1, 2, 5)]
    for axes in drawn[0].axes:
        (x_min, x_max), (y_min, y_max) = axes.get_xlim(), axes.get_ylim()
        (bar,) = axes.lines
        (left, low), (right, high) = bar.get_xydata()
        expected_m = max(m for m in rounds_m if m <= (x_max - x_min) / 3.0 * (1.0 + 1e-12))
        assert right - left == pytest.approx(expected_m)
        assert axes.texts[0].get_text() == f"{expected_m:g} m"
        assert x_min < left < right < x_max
        assert y_min < low == high < y_min + 0.2 * (y_max - y_min)
        assert high < axes.texts[0].get_position()[1] < y_min + 0.2 * (y_max - y_min)
        assert axes.texts[0].get_position()[0] == left
    whole, closer = drawn[0].axes
    assert (whole.get_xlabel(), whole.get_ylabel()) == ("x [m]", "y [m]")
    assert closer.get_xlabel() == "x [m]"
    assert closer.get_title() == "no cell differs"
    names = [text.get_text() for text in drawn[0].legends[0].get_texts()]
    assert names == ["wall in both", "wall only in EST", "wall only in REF", "free in both",
                     "unknown in either"]  # fmt: skip


def test_every_kind_of_cell_has_the_colour_that_the_legend_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At its place, row 0 at the bottom; in both views."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    geometry = GridGeometry(-1.0, 2.0, 0.5, 2, 3)
    reference = OccupancyGrid(geometry, np.array([[1, 1, 0], [0, np.nan, 1]], dtype=np.float32))
    estimate = OccupancyGrid(geometry, np.array([[1, 0, 1], [0, 1, np.nan]], dtype=np.float32))
    save_difference(tmp_path / "d.png", reference, estimate)
    words = [["wall in both", "wall only in REF", "wall only in EST"],
             ["free in both", "unknown in either", "unknown in either"]]  # fmt: skip
    (legend,) = drawn[0].legends
    colors = {
        text.get_text(): patch.get_facecolor()
        for text, patch in zip(legend.get_texts(), legend.get_patches(), strict=True)
    }
    assert len(set(colors.values())) == 5
    for axes in drawn[0].axes:
        (image,) = axes.images
        assert (tuple(image.get_extent()), image.origin) == (geometry.extent_m, "lower")
        shown = image.to_rgba(image.get_array())
        np.testing.assert_allclose(shown, [[colors[word] for word in row] for row in words])
