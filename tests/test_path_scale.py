# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The scale that would fit a path best, and the stretches that it is measured over."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_evaluation import in_evo, noisy, room_drive

from slarm_graph.eval.association import associate
from slarm_graph.eval.trajectory_accuracy import relative_errors
from slarm_graph.eval.trajectory_metrics import trajectory_metrics
from slarm_graph.spatial import in_space


@pytest.mark.parametrize("size", [1e-3, 0.1, 1.0, 100.0])
def test_the_scale_of_a_path_of_any_size_is_that_of_evo(size: float) -> None:
    """Units are nobody's business: an estimate in millimetres has the scale that makes metres."""
    reference = room_drive()
    poses = noisy(reference).poses * [size, size, 1.0]
    pairs = associate(reference, replace(reference, poses=poses))
    found = {metric.name: metric.value for metric in trajectory_metrics(pairs)}
    ours = in_evo(in_space(replace(reference, poses=poses)))
    *_, scale = ours.align(in_evo(in_space(reference)), correct_scale=True)
    assert found["scale_ratio"] == pytest.approx(scale, rel=1e-9)
    assert found["scale_ratio"] * size == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("delta", "unit", "words"),
    [(1, "frames", "199 consecutive stretches of 1 frame"),
     (100, "frames", "1 consecutive stretch of 100 frames"),
     (0.1, "s", "199 consecutive stretches of 0.1 s")],
)  # fmt: skip
def test_stretches_are_counted_in_words(delta: float, unit: str, words: str) -> None:
    path = room_drive(200)
    assert relative_errors(associate(path, path), delta, unit).note == words


def test_what_stands_still_has_no_scale() -> None:
    path = room_drive()
    pairs = associate(path, replace(path, poses=0.0 * path.poses + [3.0, 4.0, 1.0]))
    assert "scale_ratio" not in {metric.name for metric in trajectory_metrics(pairs)}
