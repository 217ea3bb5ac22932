# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of trajectories for print: the maps hold their paths, and any trajectory has some."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from test_evaluation import noisy, room_drive

from slarm_graph.eval.alignment import fit
from slarm_graph.eval.evaluation import Evaluation, EvaluationOptions, evaluate
from slarm_graph.eval.trajectory_accuracy import absolute_errors, absolute_rotations_rad, drift
from slarm_graph.eval.trajectory_plots import BackgroundMap, _paths, _thin, save_plots
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.spatial import in_space


def drawn_by(
    evaluations: dict[str, Evaluation],
    folder: Path,
    patch: pytest.MonkeyPatch,
    below: BackgroundMap | None = None,
) -> dict[str, Figure]:
    drawn: dict[str, Figure] = {}
    patch.setattr(Figure, "savefig", lambda self, path, **_: drawn.update({path.stem: self}))
    save_plots(folder, evaluations, below)
    return drawn


def test_printed_paths_lie_on_a_map_that_holds_them_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A metre is as long up as across, and a tenth of the way is no margin."""
    path = room_drive(60)
    found = evaluate(in_space(path), in_space(noisy(path)), EvaluationOptions())
    drawn = drawn_by({"one": found, "other": found}, tmp_path, monkeypatch)
    maps = [*drawn["paths"].axes, *drawn["error_on_path"].axes[:2]]
    low, high = path.poses[:, :2].min(axis=0), path.poses[:, :2].max(axis=0)
    for axes in maps:
        assert axes.get_aspect() == 1.0
        limits = np.array([axes.get_xlim(), axes.get_ylim()])
        assert (limits[:, 0] < low).all()
        assert (limits[:, 1] > high).all()
        assert (np.diff(limits)[:, 0] < 1.3 * (high - low).max() + 0.5).all()


@cache
def found_of(count: int, paths: int) -> dict[str, Evaluation]:
    path = in_space(room_drive(count))
    sigmas_m = {f"path {k}": 0.02 * (k + 1) for k in range(paths)}
    return {
        name: evaluate(path, in_space(noisy(room_drive(count), sigma_m=m)), EvaluationOptions())
        for name, m in sigmas_m.items()
    }


def test_every_axis_says_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = drawn_by(found_of(60, 2), tmp_path, monkeypatch)
    words = {
        name: [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]
        for name, figure in drawn.items()
    }
    place = ("x [m]", "y [m]")
    assert words == {
        "paths": [place],
        "error_on_path": [place, place, *[("", "position error [m]")] * 2],
        "error": [("", "position error [m]"), ("", ""), ("time [s]", "rotation error [deg]"),
                  ("distance [m]", "")],
        "rpe_by_length": [("length of the stretch [m]", "translation error [%]"),
                          ("length of the stretch [m]", "rotation error [deg/m]")],
    }  # fmt: skip


def test_errors_are_drawn_over_time_and_distance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluations = found_of(60, 2)
    axes = drawn_by(evaluations, tmp_path, monkeypatch)["error"].axes
    for index, found in enumerate(evaluations.values()):
        off_m = absolute_errors(found.pairs, found.alignment)
        turned = np.degrees(absolute_rotations_rad(found.pairs, found.alignment))
        for panel, along, error in (
            (0, found.pairs.seconds, off_m), (1, found.pairs.metres, off_m),
            (2, found.pairs.seconds, turned), (3, found.pairs.metres, turned),
        ):  # fmt: skip
            line = axes[panel].lines[index]
            np.testing.assert_allclose(line.get_xydata(), np.column_stack([along, error]))
    assert all(one.get_ylim()[0] == 0.0 for one in axes)
    assert [one.get_label() for one in axes[0].lines] == list(evaluations)


@pytest.mark.parametrize("paths", [1, 2, 3])
def test_boxes_stand_side_by_side_about_their_length(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, paths: int
) -> None:
    """In order, apart, within their length's share of the axis; the middle is the median."""
    evaluations = found_of(60, paths)
    for axes, value in zip(
        drawn_by(evaluations, tmp_path, monkeypatch)["rpe_by_length"].axes,
        (lambda d: 100.0 * d.translation_share, lambda d: np.degrees(d.rotation_rad_m)),
        strict=True,
    ):
        boxes = np.array([[*p.get_path().get_extents().intervalx] for p in axes.patches])
        boxes = boxes.reshape(paths, -1, 2)
        assert boxes.shape[1] == len(axes.get_xticks()) == 5
        for length, row in enumerate(np.moveaxis(boxes, 1, 0)):
            assert row.mean() == pytest.approx(axes.get_xticks()[length])
            assert (row[:-1, 1] < row[1:, 0]).all()
            assert row[0, 0] > length - 0.5
            assert row[-1, 1] < length + 0.5
            np.testing.assert_allclose(np.diff(row), 0.85 * 0.8 / paths)
        medians = [line for line in axes.lines if line.get_color() == "black"]
        medians = [line for line in medians if len(set(line.get_ydata())) == 1]
        expected = [
            np.median(value(d)) for found in evaluations.values() for d in drift(found.pairs)
        ]
        heights = {float(line.get_ydata()[0]) for line in medians}
        assert all(any(abs(h - e) < 1e-9 for h in heights) for e in expected)
        told = [f"{d.length_m:.3g}" for d in drift(evaluations["path 0"].pairs)]
        assert [label.get_text() for label in axes.get_xticklabels()] == told


def test_a_path_is_coloured_by_its_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step has the error at its end; one scale for all, up to all but the worst hundredth."""
    evaluations = found_of(60, 3)
    figure = drawn_by(evaluations, tmp_path, monkeypatch)["error_on_path"]
    errors = [absolute_errors(e.pairs, e.alignment) for e in evaluations.values()]
    top = max(np.quantile(error, 0.99) for error in errors)
    for axes, error, found in zip(figure.axes, errors, evaluations.values(), strict=False):
        (lines,) = axes.collections
        np.testing.assert_allclose(lines.get_array(), error[1:])
        assert lines.get_clim() == pytest.approx((0.0, top))
        moved = found.alignment.moved(found.pairs.estimate)[:, :2]
        np.testing.assert_allclose([s[1] for s in lines.get_segments()], moved[1:])
        assert f"{np.sqrt(np.mean(error**2)):.3f} m RMSE" in axes.get_title()
    assert figure.axes[3].axison is False


def test_a_map_lies_below_the_paths_where_its_alignment_lays_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Corners of its picture, moved as the estimate's are."""
    evaluations = found_of(60, 1)
    motion = fit(
        np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[3.0, 1.0], [3.0, 3.0]]), scaled=True
    )
    values = np.array([[0.0, 1.0, np.nan]], dtype=np.float32)
    grid = OccupancyGrid(GridGeometry(-1.0, 2.0, 0.5, 1, 3), values)
    axes = drawn_by(evaluations, tmp_path, monkeypatch, (grid, motion))["paths"].axes[0]
    (image,) = axes.images
    assert image.get_array().tolist() == [[1.0, 0.25, 0.93]]
    assert image.origin == "lower"
    assert tuple(image.get_extent()) == grid.geometry.extent_m
    to_axes = image.get_transform() - axes.transData
    moved = motion.moved(np.array([[-1.0, 2.0, 0.0], [0.5, 2.5, 0.0]]))[:, :2]
    np.testing.assert_allclose(to_axes.transform([[-1.0, 2.0], [0.5, 2.5]]), moved)


def test_prints_need_no_drift(tmp_path: Path) -> None:
    still = replace(room_drive(20), poses=np.zeros((20, 3)))
    save_plots(tmp_path, {"still": evaluate(in_space(still), in_space(still), EvaluationOptions())})


def test_the_paths_are_the_reference_and_every_estimate_moved_onto_it() -> None:
    """The reference pale and broad below; estimates apart by colour and, in grey, by dashes."""
    evaluations = found_of(60, 3)
    (axes,) = _paths(evaluations, None).axes
    truth, *estimates = axes.lines
    np.testing.assert_allclose(truth.get_xydata(), room_drive(60).poses[:, :2])
    for line, found in zip(estimates, evaluations.values(), strict=True):
        moved = found.alignment.moved(found.pairs.estimate)
        np.testing.assert_allclose(line.get_xydata(), moved[:, :2])
        assert line.get_linewidth() < truth.get_linewidth()
    assert len({line.get_color() for line in axes.lines}) == 4
    assert len({line.get_linestyle() for line in estimates}) == 3
    told = [text.get_text() for text in axes.get_legend().get_texts()]
    assert told == ["reference", *evaluations]


def test_long_lines_are_drawn_from_every_so_many_th_point_and_at_most_5000() -> None:
    for count, step in ((0, 1), (5_000, 1), (5_001, 2), (10_000, 2), (10_001, 3)):
        points = np.arange(2.0 * count).reshape(-1, 2)
        assert _thin(points).tolist() == points[::step].tolist()
