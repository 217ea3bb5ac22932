# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The page's curves: what is drawn over what, and what is no curve."""

from __future__ import annotations

import base64
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from test_evaluation import noisy, room_drive

from slarm_graph.backend import Table
from slarm_graph.eval.alignment import align
from slarm_graph.eval.association import associate
from slarm_graph.eval.run_figures import error_figure, table_figure
from slarm_graph.eval.trajectory_accuracy import absolute_errors, absolute_rotations_rad
from slarm_graph.geometry import Floats

COUNT = 12


def table(stamp: str = "stamp_s", **columns: list[float]) -> Table:
    """Rows half a unit of the stamp apart, from 7 on."""
    every = {stamp: [7.0 + 0.5 * k for k in range(COUNT)], **columns}
    rows = list(zip(*every.values(), strict=True))
    return Table("updates", tuple(every), rows)


def values_of(data: Any) -> Floats:
    """Numbers of an axis, also where they are packed as bytes."""
    if isinstance(data, dict):
        return np.frombuffer(base64.b64decode(data["bdata"]), data["dtype"]).astype(np.float64)
    return np.asarray(data, dtype=np.float64)


def test_every_series_has_a_curve_over_seconds_since_the_first_row() -> None:
    n_eff, spread = [k**1.5 for k in range(COUNT)], [5.0 - 0.1 * k for k in range(COUNT)]
    found = table_figure(table(n_eff=n_eff, map_spread=spread))
    assert found is not None
    figure = found.content
    assert [note.text for note in figure.layout.annotations] == [
        "effective sample size N_eff", "map spread"
    ]  # fmt: skip
    for trace, values in zip(figure.data, (n_eff, spread), strict=True):
        np.testing.assert_allclose(values_of(trace.x), 0.5 * np.arange(COUNT))
        np.testing.assert_allclose(values_of(trace.y), values, rtol=1e-6)
        assert trace.showlegend is False
    assert [trace.xaxis for trace in figure.data] == ["x", "x2"]
    # Time is named once, below the last.
    assert figure.layout.xaxis.title.text is None
    assert figure.layout.xaxis2.title.text == "time [s]"
    assert figure.layout.yaxis.rangemode == figure.layout.yaxis2.rangemode == "tozero"
    assert figure.data[0].line.color != figure.data[1].line.color
    assert found.height_px == 2 * (130 + 30) + 120


def test_nanoseconds_are_seconds_on_the_axis() -> None:
    found = table_figure(table("stamp_ns", n=[float(k % 5) for k in range(COUNT)]))
    assert found is not None
    np.testing.assert_allclose(values_of(found.content.data[0].x), 0.5e-9 * np.arange(COUNT))


@pytest.mark.parametrize(
    "values",
    [
        [1.0] * COUNT,  # nothing changes
        [float(k % 2) for k in range(COUNT)],  # a flag
        [float("nan")] + [float(k) for k in range(COUNT - 1)],
        ["x"] * COUNT,
    ],
)
def test_what_is_no_series_of_numbers_has_no_curve(values: list[Any]) -> None:
    assert table_figure(table(flag=values)) is None
    both = table_figure(table(flag=values, n=[float(k % 3) for k in range(COUNT)]))
    assert both is not None
    assert len(both.content.data) == 1


def test_poses_stamps_and_short_tables_have_no_curve() -> None:
    rising = [float(k) for k in range(COUNT)]
    assert table_figure(table(mean_x_m=rising, theta_rad=rising, stamp_late_s=rising)) is None
    assert table_figure(Table("t", ("n",), [(k,) for k in rising])) is None
    whole = table(n=rising)
    assert table_figure(replace(whole, rows=whole.rows[:7])) is None
    assert table_figure(replace(whole, rows=whole.rows[:8])) is not None
    assert table_figure(replace(whole, rows=whole.rows[::-1])) is None


def test_rows_of_one_time_are_a_curve_and_time_that_runs_back_is_none() -> None:
    """By brute force over orders of three stamps: a curve where none is below the one before."""
    rising = [float(k) for k in range(COUNT)]
    for stamps in product((1.0, 2.0, 3.0), repeat=3):
        rows = [(float(s), k) for s, k in zip([*stamps, *[3.0] * (COUNT - 3)], rising, strict=True)]
        found = table_figure(Table("updates", ("stamp_s", "n"), rows))
        assert (found is not None) == (list(stamps) == sorted(stamps))


def test_errors_stand_over_time_and_distance() -> None:
    """Four panels, those of one row with one axis; each run in its own colour, named once."""
    path = room_drive()
    runs = {"one": (path, noisy(path)), "two": (path, noisy(path, seed=2, sigma_m=0.03))}
    found = error_figure(runs)
    assert found is not None
    figure = found.content
    traces = iter(figure.data)
    for name, (truth, estimate) in runs.items():
        pairs = associate(truth, estimate)
        alignment = align(pairs)
        errors = (
            absolute_errors(pairs, alignment),
            np.degrees(absolute_rotations_rad(pairs, alignment)),
        )
        for row, error in enumerate(errors):
            for col, along in enumerate((pairs.seconds, pairs.metres)):
                trace = next(traces)
                assert trace.name == name
                assert trace.xaxis == f"x{2 * row + col + 1}".replace("x1", "x")
                assert trace.showlegend == ((row, col) == (0, 0))
                np.testing.assert_allclose(values_of(trace.x), along, rtol=1e-6, atol=1e-6)
                np.testing.assert_allclose(values_of(trace.y), error, rtol=1e-6, atol=1e-6)
    layout = figure.layout
    titles = [layout[axis].title.text for axis in ("yaxis", "yaxis3", "xaxis3", "xaxis4")]
    assert titles == ["position error [m]", "rotation error [deg]", "time [s]", "distance [m]"]
    assert {layout[axis].type for axis in ("yaxis", "yaxis3")} == {"linear"}
    assert len({trace.line.color for trace in figure.data}) == 2


@pytest.mark.parametrize(("times", "kind"), [(15.0, "linear"), (25.0, "log")])
def test_one_run_that_is_far_worse_does_not_flatten_the_others(times: float, kind: str) -> None:
    path = room_drive()
    shifts = noisy(path).poses - path.poses
    runs = {
        name: (path, replace(path, poses=path.poses + factor * shifts))
        for name, factor in (("good", 1.0), ("bad", times))
    }
    found = error_figure(runs)
    assert found is not None
    assert found.content.layout.yaxis.type == kind


def test_runs_of_another_time_have_no_errors() -> None:
    path = room_drive()
    late = replace(path, stamps_ns=path.stamps_ns + 10**12)
    assert error_figure({"late": (path, late)}) is None
    found = error_figure({"late": (path, late), "right": (path, noisy(path))})
    assert found is not None
    assert {trace.name for trace in found.content.data} == {"right"}
