# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Best bound first finds what depth first finds, ties and all."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.frontends.scans import correlative
from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid
from slarm_graph.frontends.scans.search_pyramid import FULL, SearchPyramid, build_pyramid
from slarm_graph.frontends.scans.search_window import Window, search_every_pose, window_of
from slarm_graph.geometry import Pose2


def scene(seed: int, share: float) -> tuple[SearchPyramid, Window, np.ndarray]:
    """Cells that are full or empty, and few points: many poses are as good as the best."""
    rng = np.random.default_rng(seed)
    values = (rng.random((60, 50)) < share).astype(np.float32)
    grid = LikelihoodGrid(-1.5, -1.2, 0.05, 0.04, values)
    pyramid = build_pyramid(grid, max_radius_m=1.0, levels=5)
    points = rng.uniform(-0.9, 0.9, (int(rng.integers(2, 12)), 2))
    window = window_of(pyramid, points, Pose2(0.1, 0.2, 0.3), pyramid.step_rad, 0.6, 0.5)
    return pyramid, window, values


def depth_first(pyramid: SearchPyramid, window: Window, floor: int) -> tuple[np.ndarray, int]:
    """What is found without knowing the best sum beforehand."""
    level = correlative._top_level(pyramid.layout, window)
    roots, scored = correlative._roots(pyramid.cells, pyramid.layout, window, level, floor)
    roots = roots[np.argsort(-roots[:, 3], kind="stable")]
    best = np.array([0, 0, 0, floor], dtype=np.int64)
    scored += correlative._descend_all(pyramid.cells, pyramid.layout, window, roots, level, best)
    return best, scored


@pytest.mark.parametrize("share", [0.02, 0.2, 0.6])
@pytest.mark.parametrize("seed", range(12))
def test_the_same_of_all_that_are_best(seed: int, share: float) -> None:
    pyramid, window, values = scene(seed, share)
    best, _ = correlative._branch_and_bound(pyramid, window, 0)
    expected, _ = depth_first(pyramid, window, 0)
    np.testing.assert_array_equal(best, expected)
    *_, most = search_every_pose(values, window)
    assert best[3] == round(most) * FULL
    for floor in (int(best[3]) - 1, int(best[3])):
        found, _ = correlative._branch_and_bound(pyramid, window, floor)
        np.testing.assert_array_equal(found, depth_first(pyramid, window, floor)[0])
