# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Small objects: told apart by the gaps between their returns."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.frontends.scans.small_objects import gap_per_range, is_wide
from slarm_graph.geometry import Floats


def ring_of(bearings: Floats) -> Floats:
    """Points (K, 2) three metres away [m]."""
    return 3.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)


@pytest.mark.parametrize("beams_rad", [0.003, 0.02, 0.05])
def test_a_wall_met_at_ten_degrees_has_no_gaps(beams_rad: float) -> None:
    """Where the next beam meets the line that the one along x meets in (1, 0)."""
    slope = np.array([math.cos(math.radians(10.0)), math.sin(math.radians(10.0))])
    beam = np.array([math.cos(beams_rad), math.sin(beams_rad)])
    along, _ = np.linalg.solve(np.column_stack([slope, -beam]), [-1.0, 0.0])
    wall = np.array([[1.0, 0.0], np.array([1.0, 0.0]) + along * slope])
    assert gap_per_range(7.0 * wall) == pytest.approx(along)


@pytest.mark.parametrize(
    ("beams_rad", "separate"), [(0.05, True), (0.0555, True), (0.0556, False), (0.1, False)]
)
def test_three_beams_have_to_meet_somebody_three_metres_away(
    beams_rad: float, separate: bool
) -> None:
    """Half a metre across, that is; else there is no telling things apart."""
    ring = ring_of(beams_rad * np.arange(-1, 2))
    assert math.isfinite(gap_per_range(ring)) == separate
    far = ring_of(beams_rad * np.array([-12, -11, -10, 10, 11, 12]))
    assert (not is_wide(far).any()) == separate


def test_wide_is_what_hangs_together() -> None:
    ring = ring_of(np.radians([*range(15), *range(30, 47)]))
    assert is_wide(ring).tolist() == [False] * 15 + [True] * 17
