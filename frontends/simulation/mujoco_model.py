# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A world and its robot as a MuJoCo model (MJCF)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from slarm_graph.config import SimulationConfig
from slarm_graph.convex import convex_pieces
from slarm_graph.geometry import Floats
from slarm_graph.polygons import edges_m
from slarm_graph.world import Solid, WorldMap

WHEEL_RADIUS_M: Final = 0.05
"""Wheels and body of a small indoor robot, such as a TurtleBot; results depend on motion, not on
these."""
_WHEEL_HALF_WIDTH_M: Final = 0.01
"""Half the tread of a wheel of a small indoor robot."""
_BODY_HALF_HEIGHT_M: Final = 0.05
"""Half the height of the body, which stays below every laser and antenna."""
_GROUND_CLEARANCE_M: Final = 0.03
"""Between floor and body, as wheels and casters of this size leave."""
_CASTER_RADIUS_M: Final = 0.02
"""Of the two balls that carry what the wheels do not; frictionless, so that only contact depends on
it."""
_OUTER_WALL_M: Final = 0.2
"""Thickness of the boundary, outside the world: much more than a robot moves in a step of the
physics."""

_TEMPLATE: Final = Path(__file__).with_name("robot_and_world.xml")
"""In braces what differs from world to world."""


def robot_and_world_xml(world: WorldMap, config: SimulationConfig) -> str:
    """Return MJCF of a robot at the start of a world.

    Solids are meshes of convex prisms, outer walls are boxes outside the boundary. Solids are in
    group 0, the robot in 1, the floor in 2. The robot's axle is its origin.
    """
    prisms = [
        (f"solid{n}_{k}", piece, solid)
        for n, solid in enumerate(world.solids)
        for k, piece in enumerate(convex_pieces(solid.corners_m))
    ]
    meshes = [f'<mesh name="{name}" vertex="{_prism(p, s)}"/>' for name, p, s in prisms]
    geoms = [f'<geom class="solid" type="mesh" mesh="{name}"/>' for name, _, _ in prisms]
    walls = [_outer_wall(edge, world.ceiling_m) for edge in edges_m(world.boundary_m)]
    return _TEMPLATE.read_text(encoding="utf-8").format(
        assets="".join(meshes), solids="".join([*geoms, *walls]), robot=_robot(world, config)
    )


def _prism(corners_m: Floats, solid: Solid) -> str:
    bottom = np.column_stack([corners_m, np.zeros(len(corners_m))])
    top = np.column_stack([corners_m, np.full(len(corners_m), solid.height_m)])
    return _numbers(np.concatenate([bottom, top]).ravel())


def _outer_wall(edge: Floats, height_m: float) -> str:
    """A box whose inner face is an edge of the (counter-clockwise) boundary."""
    start, step = edge[:2], edge[2:] - edge[:2]
    length = float(np.linalg.norm(step))
    outwards = np.array([step[1], -step[0]]) / length
    center = start + 0.5 * step + 0.5 * _OUTER_WALL_M * outwards
    place = _numbers([*center, 0.5 * height_m])
    size = _numbers([0.5 * length, 0.5 * _OUTER_WALL_M, 0.5 * height_m])
    turned = math.degrees(math.atan2(step[1], step[0]))
    return f'<geom class="solid" type="box" pos="{place}" size="{size}" euler="0 0 {turned:.12g}"/>'


def _robot(world: WorldMap, config: SimulationConfig) -> str:
    wheels, start = config.wheels, world.start
    half_base = 0.5 * wheels.wheel_base_m * (1.0 + wheels.wheel_base_error)
    left, right = (
        _wheel(name, side * half_base, WHEEL_RADIUS_M * (1.0 - slip))
        for name, side, slip in (("left", 1, wheels.left_slip), ("right", -1, wheels.right_slip))
    )
    body_z = _GROUND_CLEARANCE_M + _BODY_HALF_HEIGHT_M - WHEEL_RADIUS_M
    caster_x, caster_z = 0.75 * config.body_radius_m, _CASTER_RADIUS_M - WHEEL_RADIUS_M + 0.0005
    casters = "".join(
        f'<geom class="caster" size="{_CASTER_RADIUS_M}" pos="{x:.9g} 0 {caster_z:.9g}"/>'
        for x in (caster_x, -caster_x)
    )
    return (
        f'<body name="robot" pos="{_numbers([start.x, start.y, WHEEL_RADIUS_M])}"'
        f' euler="0 0 {math.degrees(start.theta):.12g}"><freejoint/>'
        f'<geom class="robot" type="cylinder" size="{config.body_radius_m} {_BODY_HALF_HEIGHT_M}"'
        f' pos="0 0 {body_z:.9g}" mass="6" friction="0.2"/>{casters}{left}{right}</body>'
    )


def _wheel(name: str, y_m: float, radius_m: float) -> str:
    return (
        f'<body name="{name}" pos="0 {y_m:.12g} 0">'
        f'<joint name="{name}" type="hinge" axis="0 1 0" damping="0.002" armature="0.001"/>'
        f'<geom class="wheel" size="{radius_m:.12g} {_WHEEL_HALF_WIDTH_M}" euler="90 0 0"/></body>'
    )


def _numbers(values: Floats | list[float]) -> str:
    return " ".join(f"{float(v):.12g}" for v in values)
