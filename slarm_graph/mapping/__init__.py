# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Beams to occupancy: one mapper for the finished map and for the map that is driven on."""

from slarm_graph.mapping.beams import end_points_m, pose_rates, thinned
from slarm_graph.mapping.mapper import GridMapper
from slarm_graph.mapping.rendering import Rendering, render

__all__ = [
    "GridMapper",
    "Rendering",
    "end_points_m",
    "pose_rates",
    "render",
    "thinned",
]
