# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Beams to occupancy: one mapper for the finished map and for the map that is driven on."""

from slarm_graph.mapping.beams import end_points_m as end_points_m
from slarm_graph.mapping.beams import pose_rates as pose_rates
from slarm_graph.mapping.beams import thinned as thinned
from slarm_graph.mapping.mapper import GridMapper as GridMapper
from slarm_graph.mapping.rendering import Rendering as Rendering
from slarm_graph.mapping.rendering import render as render
