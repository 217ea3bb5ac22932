# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From ranges to points: filter, projection, deskew, thinning."""

from __future__ import annotations

import numpy as np

from slarm_graph.config import FrontendConfig
from slarm_graph.frontends.scans.scan_filter import points_for_matching
from slarm_graph.geometry import Pose2
from slarm_graph.readings import LaserScan

ALL = FrontendConfig(point_spacing_m=0.0)


def scan_of(ranges: list[float], **more: object) -> LaserScan:
    return LaserScan(np.array(ranges), -0.5, 0.1, 0.1, 10.0, **more)  # type: ignore[arg-type]


def test_equals_the_scans_own_points_without_motion() -> None:
    scan = scan_of([1.0, 2.0, 3.0, 4.0], robot_from_laser=Pose2(0.2, -0.1, 1.0))
    np.testing.assert_allclose(points_for_matching(scan, ALL), scan.points_m(), atol=1e-12)


def test_what_is_no_return_is_left_out() -> None:
    scan = scan_of([np.nan, np.inf, -np.inf, 0.05, 10.5, 5.0])
    assert len(points_for_matching(scan, ALL)) == 1
    near = FrontendConfig(point_spacing_m=0.0, max_range_m=4.0)
    assert len(points_for_matching(scan, near)) == 0
    assert points_for_matching(scan_of([]), ALL).shape == (0, 2)


def test_thinning_keeps_a_spacing_along_the_beams() -> None:
    scan = LaserScan(np.full(2000, 1.0), -3.0, 0.003, 0.1, 10.0)
    points = points_for_matching(scan, FrontendConfig(point_spacing_m=0.05))
    gaps = np.hypot(*np.diff(points, axis=0).T)
    assert gaps.min() >= 0.05
    assert gaps.max() < 0.06


def test_deskew_puts_a_turning_robots_wall_straight() -> None:
    """A robot turning on the spot before a wall at x = 2 m sees it straight after deskewing."""
    beams, step_s, turn_rad_s = 200, 0.0005, 2.0
    angles = -0.5 + 0.005 * np.arange(beams)
    heading = turn_rad_s * step_s * np.arange(beams)
    ranges = 2.0 / np.cos(angles + heading)
    scan = LaserScan(ranges, -0.5, 0.005, 0.1, 10.0, time_increment_s=step_s)
    rate = np.array([0.0, 0.0, turn_rad_s])
    np.testing.assert_allclose(points_for_matching(scan, ALL, rate)[:, 0], 2.0, atol=1e-9)
    off = FrontendConfig(point_spacing_m=0.0, deskew=False)
    assert np.ptp(points_for_matching(scan, off, rate)[:, 0]) > 0.05


def test_the_reference_beam_only_moves_the_frame() -> None:
    scan = scan_of([1.0, 2.0, 3.0, 4.0], time_increment_s=0.01)
    rate = np.array([0.5, 0.1, 1.0])
    first, later = (points_for_matching(scan, ALL, rate, beam) for beam in (0.0, 2.0))
    first_from_later = Pose2(0.5 * 0.02, 0.1 * 0.02, 1.0 * 0.02)
    # The velocity is held in the reference frame, so the two agree to second order.
    np.testing.assert_allclose(first_from_later.transform(later), first, atol=5e-4)
