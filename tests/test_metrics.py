# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of metrics: every figure is in it, in its order, with those of plug-ins."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from slarm_graph import parts
from slarm_graph.eval import metric_parts, metric_table
from slarm_graph.eval.assessment import assess
from slarm_graph.eval.metric_parts import Subject
from slarm_graph.eval.metric_table import headlines, in_table_order, kind_of, kinds
from slarm_graph.eval.metrics import Metric, MetricKind
from slarm_graph.trajectory import Trajectory

ROOT = Path(__file__).resolve().parents[1]


def line() -> Trajectory:
    poses = np.zeros((5, 3))
    poses[:, 0] = np.arange(5.0)
    return Trajectory(np.arange(5, dtype=np.int64) * 1_000_000_000, poses)


def literal_names() -> set[str]:
    """Names given to `Metric(...)` as plain text anywhere in the package."""
    rooms = ("slarm_graph", "eval", "backends", "frontends")
    files = [path for room in rooms for path in (ROOT / room).rglob("*.py")]
    return {
        node.args[0].value
        for path in files
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Metric"
        and node.args
        and isinstance(node.args[0], ast.Constant)
        and isinstance(node.args[0].value, str)
    }


def test_every_metric_of_the_package_is_in_the_table() -> None:
    missing = literal_names() - set(kinds())
    assert not missing, f"add to eval/metric_kinds.csv: {sorted(missing)}"


def test_names_say_their_unit() -> None:
    suffixes = {"m": "m", "s": "s", "deg": "deg", "dB": "db", "nat": "nat", "MB": "mb"}
    for kind in kinds().values():
        assert kind.title, kind.name
        if kind.unit in suffixes:
            assert kind.name.endswith(f"_{suffixes[kind.unit]}"), kind.name


def test_the_order_is_the_tables_and_the_first_of_a_name_stays() -> None:
    given = [Metric("strange", 1.0), Metric("wall_s", 2.0), Metric("accuracy", 3.0)]
    ordered = in_table_order([*given, Metric("accuracy", 4.0)])
    assert [(m.name, m.value) for m in ordered] == [
        ("accuracy", 3.0),
        ("wall_s", 2.0),
        ("strange", 1.0),
    ]


def test_an_unknown_name_is_read_for_its_unit() -> None:
    assert kind_of("end_spread_m") == MetricKind(
        "end_spread_m", "m", "end spread", "", "always", ""
    )
    assert kind_of("share").unit == ""


class Straightness:
    """A plug-in's metrics."""

    kinds = (
        MetricKind("straightness", "", "straightness", "more", "always", "end over path", True),
    )

    def measure(self, subject: Subject) -> list[Metric]:
        poses = subject.trajectory.poses[:, :2]
        ends = float(np.linalg.norm(poses[-1] - poses[0]))
        return [Metric("straightness", ends / subject.trajectory.path_length_m())]


class Broken:
    """A plug-in that fails."""

    kinds = ()

    def measure(self, subject: Subject) -> list[Metric]:
        raise ZeroDivisionError("oh")


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    entries = [
        EntryPoint(name, f"test_metrics:{name}", "slarm_graph.metrics")
        for name in ("Straightness", "Broken", "Gone")
    ]
    monkeypatch.setattr(parts, "entry_points", lambda group: entries)
    parts._added.cache_clear()
    metric_parts.parts.cache_clear()
    metric_table.kinds.cache_clear()
    yield
    parts._added.cache_clear()
    metric_parts.parts.cache_clear()
    metric_table.kinds.cache_clear()


@pytest.mark.usefixtures("plugged")
def test_plug_ins_add_metrics_and_cost_no_run(caplog: pytest.LogCaptureFixture) -> None:
    measured = {m.name: m for m in assess(Subject(line()))}
    assert measured["straightness"].value == 1.0
    assert measured["straightness"].kind.title == "straightness"
    assert measured["path_length_m"].value == 4.0
    assert "straightness" in [kind.name for kind in headlines()]
    assert "Gone" in caplog.text
    assert "Broken failed: oh" in caplog.text
