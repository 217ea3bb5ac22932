# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rooms scanned without a simulator: an oracle of its own for recovery."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from slarm_graph.config import LidarConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

WORLD = load_world("paper_room")
PAPER_LOOP = [[-4.25, -2.9], [4.4, -2.2], [3.75, -0.4], [3.75, 2.6], [-1.1, 2.15], [-4.25, 2.2]]


def scanned_room(sigma_m, drift_m, world=WORLD, loop=PAPER_LOOP):
    """Scans along a loop through a room, cast here against the outlines of its solids."""
    lidar = LidarConfig()
    loop = np.array(loop)
    loop = np.concatenate([loop, loop[:1]])
    stations = np.concatenate([np.linspace(a, b, 25, endpoint=False) for a, b in pairwise(loop)])
    segments = [(world.boundary_m, np.roll(world.boundary_m, -1, axis=0))]
    segments += [(s.corners_m, np.roll(s.corners_m, -1, axis=0)) for s in world.solids]
    starts = np.concatenate([a for a, _ in segments])
    steps = np.concatenate([b for _, b in segments]) - starts
    angles = -math.pi + np.arange(360) * math.tau / 360
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rng = np.random.default_rng(1)
    scans = []
    for station in stations:
        cross = beams[:, None, 0] * steps[None, :, 1] - beams[:, None, 1] * steps[None, :, 0]
        rel = starts - station
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (rel[:, 0] * steps[:, 1] - rel[:, 1] * steps[:, 0]) / cross
            share = rel[None, :, 0] * beams[:, None, 1] - rel[None, :, 1] * beams[:, None, 0]
            share = share / cross
        far = np.where((far > 0) & (share >= -1e-9) & (share <= 1 + 1e-9), far, np.inf)
        ranges = far.min(axis=1) + rng.normal(0.0, sigma_m, 360)
        scans.append(
            LaserScan(
                ranges_m=ranges.astype(np.float32),
                angle_min_rad=-math.pi,
                angle_increment_rad=math.tau / 360,
                range_min_m=lidar.range_min_m,
                range_max_m=lidar.range_max_m,
            )
        )
    drift = drift_m * np.sin(np.linspace(0, math.tau, len(stations)))
    poses = np.column_stack([stations + drift[:, None], np.zeros(len(stations))])
    stamps = np.arange(len(stations)) * 2_000_000_000
    return scans, Trajectory(stamps, poses)
