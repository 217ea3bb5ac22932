# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated buildings that are hard to map: wards of rooms all alike, halls, offices.

Building n is a ward, a hall or an office by turns; its size, its robot's laser and wheels, and how
many people walk about follow from n alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from slarm_graph.config import SimulationConfig
from slarm_graph.config.driving import LidarConfig, WheelConfig
from slarm_graph.eval.relations import Relations
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld
from slarm_graph.geometry import Floats, Pose2, between
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import Solid, WorldMap

KINDS: Final = ("ward", "hall", "office")
_WALL_M = 0.12
"""A partition of plasterboard on both sides of a frame."""
_DOOR_M = 1.1
"""A door that a bed or a wheelchair passes (DIN 18040: at least 0.9)."""
_HIGH_M, _GLASS_M = 2.7, 0.1
"""Walls reach the ceiling; of a pane the laser, 0.2 m up, meets nothing, the robot the sill."""
_BODY_M = 0.25
"""Half the width of a person's trunk and arms."""
_NEAR_M = (1.0, 6.0)
"""A passer-by comes into being and is forgotten as far from the robot."""
_EVERY_M, _REVISIT_M, _AWAY_M = 1.0, 2.0, 20.0
"""Way between the poses that relations are of; how near a pose must be come to again, and by what
way in between: as those of the Freiburg benchmark, which join scans that see the same."""
_WALK_M_S = 0.8
"""Standard deviation of a walker's velocity along an axis: some stand, some walk at 1.4 m/s."""


def building(number: int) -> tuple[WorldMap, SimulationConfig, int]:
    """Return a building, the robot in it, and how many people are about."""
    rng = np.random.default_rng(number)
    kind = KINDS[number % len(KINDS)]
    world = _hall(rng) if kind == "hall" else _rooms(rng, alike=kind == "ward")
    lidar = LidarConfig(
        beams=int(rng.choice([121, 181, 361, 541])),
        field_of_view_rad=math.radians(rng.choice([120, 180, 240, 270, 360])),
        rate_hz=5.0,
        range_max_m=float(rng.choice([5.6, 8.0, 12.0, 20.0, 30.0])),
        sigma_m=float(rng.uniform(0.01, 0.04)),
    )
    wheels = WheelConfig(
        wheel_base_error=float(rng.uniform(-0.03, 0.03)),
        left_slip=float(rng.uniform(-0.001, 0.001)),
        right_slip=float(rng.uniform(-0.001, 0.001)),
        random_slip_m_per_sqrt_m=float(rng.uniform(0.001, 0.006)),
    )
    name = f"{kind} {number}"
    config = SimulationConfig(lidar=lidar, wheels=wheels)
    return replace(world, name=name), config, int(rng.integers(0, 7))


def recording(number: int) -> tuple[list[Reading], Trajectory]:
    """Drive through a building: its readings, and the true path."""
    world, config, people = building(number)
    source = SourceFromWorld(world, config, seed=number)
    readings = list(source)
    truth = source.truth()
    rng = np.random.default_rng(1000 + number)
    return list(with_people(readings, truth.poses, people, rng)), truth


def relations_of(truth: Trajectory) -> Relations:
    """Draw relations of a true path: each metre with the next, and twice as many with revisits."""
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth.poses[:, :2], axis=0).T))])
    at = np.unique(np.searchsorted(way_m, np.arange(0.0, way_m[-1], _EVERY_M)))
    poses, way_m = truth.poses[at], way_m[at]
    away_m = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    apart_m = np.abs(way_m[:, None] - way_m[None, :])
    again = np.argwhere(np.triu((away_m < _REVISIT_M) & (apart_m > _AWAY_M)))
    np.random.default_rng(0).shuffle(again)
    along = np.stack([np.arange(len(at) - 1), np.arange(1, len(at))], axis=1)
    first, second = np.concatenate([along, again[: 2 * len(along)]]).T
    stamps_ns = truth.stamps_ns[at]
    pairs = np.stack([stamps_ns[first], stamps_ns[second]], axis=1)
    return Relations(pairs, between(poses[first], poses[second]))


def with_people(
    readings: list[Reading], poses: Floats, count: int, rng: np.random.Generator
) -> Iterator[Reading]:
    """Let people walk about the robot, whose poses (N, 3) in any fixed frame are given."""
    where = np.full((count, 2), np.inf)
    velocity = np.zeros((count, 2))
    stamps_s = [reading.stamp_ns * 1e-9 for reading in readings]
    for k, (reading, pose) in enumerate(zip(readings, poses, strict=True)):
        # Through a silence of the recording nobody is followed.
        where = where + min(stamps_s[k] - stamps_s[max(k - 1, 0)], 1.0) * velocity
        away = np.hypot(*(where - pose[:2]).T)
        for one in np.flatnonzero(~((away > _NEAR_M[0]) & (away < _NEAR_M[1]))):
            bearing, far = rng.uniform(-math.pi, math.pi), rng.uniform(*_NEAR_M)
            where[one] = pose[:2] + far * np.array([math.cos(bearing), math.sin(bearing)])
            velocity[one] = rng.normal(0.0, _WALK_M_S, 2)
        yield _hidden_behind(reading, where, pose)


def _hidden_behind(reading: Reading, people: Floats, pose: Floats) -> Reading:
    """Shorten the beams that meet one of the people (P, 2)."""
    scan = reading.scan
    laser = Pose2.from_array(pose) @ scan.robot_from_laser
    angles = scan.angles_rad() + laser.theta
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = scan.ranges_m.copy()
    for person in people - [laser.x, laser.y]:
        ahead = along @ person
        half_chord2 = _BODY_M**2 - (person @ person - ahead**2)
        hit = (half_chord2 > 0) & (ahead > _BODY_M)
        ranges[hit] = np.minimum(ranges[hit], ahead[hit] - np.sqrt(half_chord2[hit]))
    return replace(reading, scan=replace(scan, ranges_m=ranges))


def _rooms(rng: np.random.Generator, *, alike: bool) -> WorldMap:
    """Four rows of rooms around a ring of corridors; alike ones are copies of one another."""
    count, width, depth, corridor = (
        int(rng.integers(5, 9)),
        float(rng.uniform(3.2, 4.5)),
        float(rng.uniform(4.0, 6.0)),
        float(rng.uniform(1.8, 2.6)),
    )
    inner = count * width
    size = np.array([inner + 2 * corridor, 4 * depth + 2 * corridor])
    rows = [
        (0.0, 1),
        (depth + corridor, -1),
        (2 * depth + corridor, 1),
        (3 * depth + 2 * corridor, -1),
    ]
    solids: list[Solid] = []
    one = _furniture(rng, width, depth)
    for low, opens in rows:
        x = corridor
        widths = np.full(count, width) if alike else rng.dirichlet(np.full(count, 30.0)) * inner
        for wide in widths:
            pieces = one if alike else _furniture(rng, wide, depth)
            glass = not alike and rng.random() < 0.2
            solids += _room(x, low, float(wide), depth, opens, pieces, glass=glass)
            x += float(wide)
    start = Pose2(corridor / 2, depth + corridor / 2, math.pi / 2)
    return _world(size, solids, start)


def _room(
    x: float, y: float, width: float, depth: float, opens: int, furniture: Floats, *, glass: bool
) -> list[Solid]:
    """Side walls, a front with a door, and furniture given from the door inwards."""
    front, back = (y + depth, y) if opens > 0 else (y, y + depth)
    door = x + 0.5 * width - 0.5 * _DOOR_M
    walls = [
        _wall(x, y, x, y + depth),
        _wall(x + width, y, x + width, y + depth),
        _wall(x, front, door, front, glass=glass),
        _wall(door + _DOOR_M, front, x + width, front, glass=glass),
        _wall(x, back, x + width, back),
    ]
    for left, inwards, long, deep in furniture:
        near = front - opens * inwards
        far = near - opens * deep
        walls.append(_box(x + left, min(near, far), x + left + long, max(near, far)))
    return walls


def _furniture(rng: np.random.Generator, width: float, depth: float) -> Floats:
    """Beds or desks along the side walls and the back: left, inwards, long, deep (K, 4) [m]."""
    long, deep = rng.uniform(0.6, 1.2), rng.uniform(1.0, 2.0)
    pieces = [[0.1, depth - deep - 0.2, long, deep]]
    if rng.random() < 0.7:
        pieces.append([width - 0.6, rng.uniform(1.4, 0.5 * depth), 0.5, rng.uniform(0.5, 1.2)])
    return np.array(pieces)


def _hall(rng: np.random.Generator) -> WorldMap:
    """A hall with pillars in rows, and stands between them."""
    size = rng.uniform([28.0, 20.0], [50.0, 34.0])
    pitch = rng.uniform(5.0, 8.0)
    solids = [
        _box(x - 0.25, y - 0.25, x + 0.25, y + 0.25)
        for x in np.arange(0.5 * pitch, size[0], pitch)
        for y in np.arange(0.5 * pitch, size[1], pitch)
    ]
    for _ in range(int(rng.integers(4, 16))):
        low = rng.uniform([3.0, 3.0], size - 5.0)
        solids.append(_box(*low, *(low + rng.uniform([0.5, 0.5], [3.0, 1.5]))))
    return _world(size, solids, Pose2(1.2, 1.2, math.pi / 4))


def _world(size: Floats, solids: list[Solid], start: Pose2) -> WorldMap:
    boundary = np.array([[0.0, 0.0], [size[0], 0.0], [size[0], size[1]], [0.0, size[1]]])
    return WorldMap("building", tuple(solids), boundary, _HIGH_M, (), start)


def _wall(x_0: float, y_0: float, x_1: float, y_1: float, *, glass: bool = False) -> Solid:
    half = 0.5 * _WALL_M
    return _box(x_0 - half, y_0 - half, x_1 + half, y_1 + half, _GLASS_M if glass else _HIGH_M)


def _box(x_0: float, y_0: float, x_1: float, y_1: float, height_m: float = _HIGH_M) -> Solid:
    corners = np.array([[x_0, y_0], [x_1, y_0], [x_1, y_1], [x_0, y_1]])
    return Solid("box", corners, height_m)
