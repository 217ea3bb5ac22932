# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rooms scanned without a simulator: an oracle of its own for recovery."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.ndimage import distance_transform_edt

from slarm_graph.config import LidarConfig
from slarm_graph.exploration.algorithm_1 import ggmr_path
from slarm_graph.exploration.coverage_grid import known_coverage
from slarm_graph.files.worlds import load_world
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import truth_map

WORLD = load_world("paper_room")
PAPER_LOOP = [[-4.25, -2.9], [4.4, -2.2], [3.75, -0.4], [3.75, 2.6], [-1.1, 2.15], [-4.25, 2.2]]


def scanned_room(sigma_m, drift_m, world=WORLD, loop=PAPER_LOOP):
    """Scans along a loop through a room, of which the trajectory tells drifting poses."""
    loop = np.array(loop)
    loop = np.concatenate([loop, loop[:1]])
    stations = np.concatenate([np.linspace(a, b, 25, endpoint=False) for a, b in pairwise(loop)])
    scans = scans_from(world, stations, sigma_m, beams=360)
    drift = drift_m * np.sin(np.linspace(0, math.tau, len(stations)))
    return scans, standing(stations + drift[:, None])


def toured(world, step_m, sigma_m):
    """Scans from true poses all over a world, every one a step from the last, not through walls."""
    truth = truth_map(world, 0.1)
    roomy = distance_transform_edt(truth.reachable) * 0.1 > 0.25
    every = round(step_m / 0.1)
    cells = (slice(every // 2, None, every),) * 2
    centers, free = truth.geometry.centers()[cells], roomy[cells]
    away_m = np.hypot(*(centers - [world.start.x, world.start.y]).transpose(2, 0, 1))
    start = np.unravel_index(np.where(free, away_m, np.inf).argmin(), free.shape)
    path = ggmr_path(known_coverage(free), (int(start[0]), int(start[1])))
    stations = centers[tuple(path.cells.T)]
    return scans_from(world, stations, sigma_m, beams=720), standing(stations)


def standing(stations):
    """A trajectory of poses two seconds apart that all head along x."""
    poses = np.column_stack([stations, np.zeros(len(stations))])
    return Trajectory(np.arange(len(stations)) * 2_000_000_000, poses)


def scans_from(world, stations, sigma_m, *, beams):
    """Scans cast here against the outlines of a world's solids."""
    lidar = LidarConfig()
    segments = [(world.boundary_m, np.roll(world.boundary_m, -1, axis=0))]
    segments += [(s.corners_m, np.roll(s.corners_m, -1, axis=0)) for s in world.solids]
    starts = np.concatenate([a for a, _ in segments])
    steps = np.concatenate([b for _, b in segments]) - starts
    angles = -math.pi + np.arange(beams) * math.tau / beams
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rng = np.random.default_rng(1)
    scans = []
    for station in stations:
        cross = rays[:, None, 0] * steps[None, :, 1] - rays[:, None, 1] * steps[None, :, 0]
        rel = starts - station
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (rel[:, 0] * steps[:, 1] - rel[:, 1] * steps[:, 0]) / cross
            share = rel[None, :, 0] * rays[:, None, 1] - rel[None, :, 1] * rays[:, None, 0]
            share = share / cross
        far = np.where((far > 0) & (share >= -1e-9) & (share <= 1 + 1e-9), far, np.inf)
        ranges = far.min(axis=1) + rng.normal(0.0, sigma_m, beams)
        scans.append(
            LaserScan(
                ranges_m=ranges.astype(np.float32),
                angle_min_rad=-math.pi,
                angle_increment_rad=math.tau / beams,
                range_min_m=lidar.range_min_m,
                range_max_m=lidar.range_max_m,
            )
        )
    return scans
