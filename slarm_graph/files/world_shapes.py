# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Polygons of boxes and of walls with a thickness."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.geometry import Floats, transform_points
from slarm_graph.polygons import counter_clockwise

# A mitre at a hairpin would be endless; this ends it at ten half thicknesses.
_SHARPEST = 0.1


def rectangle_m(
    center_m: tuple[float, float], size_m: tuple[float, float], heading_deg: float = 0.0
) -> Floats:
    """Corners (4, 2) of a rectangle, counter-clockwise [m]."""
    half_x, half_y = size_m[0] / 2, size_m[1] / 2
    corners = np.array([[-half_x, -half_y], [half_x, -half_y], [half_x, half_y], [-half_x, half_y]])
    if heading_deg == 0.0:
        # Adding alone keeps the corners as exact as they were stated.
        return np.asarray(corners + np.array(center_m))
    return transform_points([*center_m, math.radians(heading_deg)], corners)


def wall_pieces_m(line_m: Floats, thickness_m: float, *, closed: bool) -> list[Floats]:
    """One quadrilateral (4, 2) per straight piece of a centre line, mitred where pieces meet."""
    left, right = _sides(line_m, thickness_m / 2, closed)
    ends = [*range(1, len(line_m)), *([0] if closed else [])]
    return [
        counter_clockwise(np.array([right[j - 1], right[j], left[j], left[j - 1]])) for j in ends
    ]


def _sides(line: Floats, half_m: float, closed: bool) -> tuple[Floats, Floats]:
    """Corners (K, 2) of a line moved by half its thickness to the left and to the right."""
    steps = np.roll(line, -1, axis=0) - line
    normals = np.stack([-steps[:, 1], steps[:, 0]], axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    before = np.roll(normals, 1, axis=0)
    if not closed:
        before[0], normals[-1] = normals[0], before[-1]
    # The mitre lies along the sum of both normals at the length that keeps the thickness.
    mitre = before + normals
    mitre /= np.maximum(1.0 + np.sum(before * normals, axis=1, keepdims=True), _SHARPEST)
    return line + half_m * mitre, line - half_m * mitre
