# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line of sight past uncertain groups, against a mask of the whole grid for every level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.geographic import HeightGroup
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.line_of_sight import (
    line_of_sight_past_solids,
    line_of_sight_to_points,
    moved_to_faces,
)
from slarm_graph.radio.line_of_sight_probability import (
    multiply_by_group_probabilities,
    split_by_certainty,
)
from slarm_graph.raster.fill import inside_solids
from slarm_graph.world import Solid


def _solids(rng: np.random.Generator, count: int) -> list[Solid]:
    solids = []
    for number in range(count):
        center, half = rng.uniform(0.5, 9.5, 2), rng.uniform(0.02, 0.6, 2)
        turn = rng.uniform(0.0, np.pi)
        c, s = np.cos(turn), np.sin(turn)
        box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        solids.append(Solid(f"s{number}", center + box @ np.array([[c, s], [-s, c]]), 1.0))
    return solids


def _by_masks(
    geometry: GridGeometry,
    solids: list[Solid],
    groups: list[HeightGroup],
    on_face: np.ndarray,
    position_m: Floats,
) -> Floats:
    probability = np.ones(geometry.shape)
    points = moved_to_faces(geometry.center_of(np.argwhere(on_face)), solids)
    for group in groups:
        share = np.zeros(geometry.shape)
        for level in group.levels_m:
            high = [
                replace(solids[n], height_m=float(h))
                for n, h in zip(group.solids, level, strict=True)
                if h > min(0.5, position_m[2])
            ]
            clear = line_of_sight_past_solids(geometry, high, position_m, 0.5)
            clear[on_face] = line_of_sight_to_points(points, high, position_m, 0.5)
            share += clear
        probability *= share / len(group.levels_m)
    return probability


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("access_point_m", [2.5, 0.2])
def test_as_a_mask_for_every_level(seed: int, access_point_m: float) -> None:
    rng = np.random.default_rng(seed)
    geometry = GridGeometry(-0.3, 0.1, 0.1, 97, 103)
    solids = _solids(rng, 14)
    position_m = np.array([*rng.uniform(1.0, 9.0, 2), access_point_m])
    groups = [
        HeightGroup(
            tuple(range(a, a + n)), np.sort(rng.choice([0.0, 0.4, 1.0, 1.8, 3.0], (5, n)), 0)
        )
        for a, n in ((0, 4), (4, 3), (7, 1), (8, 6))
    ]
    on_face = inside_solids(geometry, solids)
    expected = _by_masks(geometry, solids, groups, on_face, position_m)
    sure, levels = split_by_certainty(solids, groups, access_point_m, 0.5)
    probability = np.ones(geometry.shape, dtype=np.float32)
    probability[~line_of_sight_past_solids(geometry, sure, position_m, 0.5)] = 0.0
    points = moved_to_faces(geometry.center_of(np.argwhere(on_face)), solids)
    probability[on_face] = line_of_sight_to_points(points, sure, position_m, 0.5)
    multiply_by_group_probabilities(probability, geometry, levels, on_face, points, position_m, 0.5)
    assert 0.1 < expected.mean() < 0.99
    np.testing.assert_allclose(probability, expected, rtol=0.0, atol=1e-6)
