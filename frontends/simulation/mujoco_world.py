# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The `World` interface on MuJoCo: contact dynamics, wheel slip by friction, rays in 3D.

Optional (`pip install slarm-graph[physics]`). Nothing here is shared with the simulator of this
package but the description of the robot: MuJoCo integrates the bodies, finds the contacts and casts
the rays from the laser wherever the tilting body holds it; odometry integrates encoder ticks of the
turning wheels.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import SimulationConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.simulation.mujoco_model import WHEEL_RADIUS_M, robot_and_world_xml
from slarm_graph.frontends.simulation.receiver import SimulatedReceiver
from slarm_graph.frontends.simulation.simulator import START_NS, beam_directions, scan_from_ranges
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading
from slarm_graph.world import DriveCommand, WorldMap

if TYPE_CHECKING:
    from types import ModuleType

_CHUNK_S: Final = 0.01
"""Simulated time between two checks of contacts and encoders: ten per scan at 10 Hz."""
_SETTLE_S: Final = 0.3
"""Time for the body to drop the half millimetre onto its wheels and to come to rest before the
drive."""
_TICKS_PER_TURN: Final = 4096
"""Twelve bits, as common magnetic wheel encoders have (AS5600)."""
_SEEN_GROUPS: Final = np.array([1, 0, 1, 0, 0, 0], dtype=np.uint8)
"""Which of MuJoCo's six groups of shapes the laser sees: obstacles and boundary, not robot nor
floor."""
_ROBOT_GROUP: Final = 1
"""MuJoCo's groups are free numbers; these only keep robot and floor apart."""
_FLOOR_GROUP: Final = 2
"""MuJoCo's groups are free numbers; these only keep robot and floor apart."""


class MujocoWorld:
    """A differential-drive robot in MuJoCo; implements `slarm_graph.world.World`.

    The systematic part of `config.wheels` becomes differences of wheel radius and wheel base; the
    random part follows from the contacts.

    Parameters
    ----------
    world : WorldMap
    config : SimulationConfig
        `lidar.sweep_s` must be 0.
    rng : numpy.random.Generator
        Source of range noise and of received signals, the only randomness.

    Raises
    ------
    ImportError
        When MuJoCo is not installed; says how to install it.
    BadInput
        When the robot would start inside a solid, or the laser sweeps.
    """

    def __init__(self, world: WorldMap, config: SimulationConfig, rng: np.random.Generator) -> None:
        if config.lidar.sweep_s:
            raise BadInput("simulation.lidar.sweep_s: the physics world takes scans at one instant")
        self.map, self.config = world, config
        self._rng = rng
        self.receiver = SimulatedReceiver(world, config.signals, rng)
        self._mujoco = _import_mujoco()
        self._model = self._mujoco.MjModel.from_xml_string(robot_and_world_xml(world, config))
        self._data = self._mujoco.MjData(self._model)
        self._period_ns = round(1e9 / config.lidar.rate_hz)
        self._stamp_ns = START_NS
        self._chunk_steps = max(1, round(_CHUNK_S / self._model.opt.timestep))
        self._directions = beam_directions(config.lidar)
        self._touching, self._collisions = False, 0
        self._settle()
        self._odom = world.start if config.wheels.start_known else Pose2()
        self._ticks = self._encoder_ticks()

    def read(self) -> Reading:
        """Return the scan and the wheel odometry at the present instant."""
        scan = scan_from_ranges(self.config.lidar, self._exact_ranges_m(), self._rng)
        signals = self.receiver.at(self._stamp_ns, self.truth())
        return Reading(self._stamp_ns, scan, self._odom, signals)

    def drive(self, command: DriveCommand) -> None:
        """Hold the command until the next reading is due."""
        turn = 0.5 * self.config.wheels.wheel_base_m * command.turn_rate_rad_s
        self._data.ctrl[:] = np.array([command.speed_m_s - turn, command.speed_m_s + turn])
        self._data.ctrl[:] /= WHEEL_RADIUS_M
        self._stamp_ns += self._period_ns
        until_s = (self._stamp_ns - START_NS) * 1e-9 - 0.5 * self._model.opt.timestep
        while self._data.time < until_s:
            self._mujoco.mj_step(self._model, self._data, nstep=self._chunk_steps)
            self._watch_contacts()
            self._watch_encoders()

    def truth(self) -> Pose2:
        """Return `world_from_robot` at the present instant."""
        x, y, _, w, i, j, k = self._data.qpos[:7]
        yaw = math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))
        return Pose2(float(x), float(y), yaw)

    def collisions(self) -> int:
        """Return how often the body has run into a solid so far."""
        return self._collisions

    def _settle(self) -> None:
        """Let the body settle on its wheels, then reset pose, velocity and clock to the start."""
        steps = round(_SETTLE_S / self._model.opt.timestep)
        self._mujoco.mj_step(self._model, self._data, nstep=steps)
        if self._solids_touched():
            x, y = self.map.start.x, self.map.start.y
            raise BadInput(
                f"{self.map.name}: start: the robot touches a solid at ({x:.3f}, {y:.3f})"
            )
        half = 0.5 * self.map.start.theta
        self._data.qpos[:2] = self.map.start.x, self.map.start.y
        self._data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
        self._data.qvel[:], self._data.time = 0.0, 0.0
        self._mujoco.mj_forward(self._model, self._data)

    def _chassis(self) -> int:
        return int(self._model.body("robot").id)

    def _exact_ranges_m(self) -> Floats:
        """Distances (B,) from the laser to whatever MuJoCo's rays meet, +inf for nothing."""
        lidar, chassis = self.config.lidar, self._chassis()
        rotation = self._data.xmat[chassis].reshape(3, 3)
        above_axle = lidar.height_m - WHEEL_RADIUS_M
        origin = self._data.xpos[chassis] + rotation @ np.array([lidar.x_m, lidar.y_m, above_axle])
        c, s = math.cos(lidar.yaw_rad), math.sin(lidar.yaw_rad)
        flat = self._directions @ np.array([[c, s], [-s, c]])
        rays = np.column_stack([flat, np.zeros(len(flat))]) @ rotation.T
        count = len(rays)
        distances, hit = np.empty(count), np.empty(count, dtype=np.int32)
        self._mujoco.mj_multiRay(
            self._model,
            self._data,
            origin,
            rays.ravel(),
            geomgroup=_SEEN_GROUPS,
            flg_static=True,
            bodyexclude=-1,
            geomid=hit,
            dist=distances,
            normal=None,
            nray=count,
            cutoff=lidar.range_max_m,
        )
        return np.where((distances < 0.0) | (distances > lidar.range_max_m), np.inf, distances)

    def _encoder_ticks(self) -> NDArray[np.int64]:
        turns = self._data.qpos[7:9] / (2.0 * math.pi)
        return np.asarray(np.floor(turns * _TICKS_PER_TURN), dtype=np.int64)

    def _watch_encoders(self) -> None:
        """Integrate the encoder increments since the last check, as a robot's firmware does."""
        ticks = self._encoder_ticks()
        per_tick_m = 2.0 * math.pi * WHEEL_RADIUS_M / _TICKS_PER_TURN
        left, right = (float(v) for v in (ticks - self._ticks) * per_tick_m)
        self._ticks = ticks
        turn = (right - left) / self.config.wheels.wheel_base_m
        self._odom = self._odom @ Pose2.exp([0.5 * (left + right), 0.0, turn])

    def _watch_contacts(self) -> None:
        touching = self._solids_touched()
        self._collisions += touching and not self._touching
        self._touching = touching

    def _solids_touched(self) -> bool:
        """Whether any part of the robot is in contact with anything but the floor."""
        pairs = self._data.contact.geom
        if not len(pairs):
            return False
        groups = self._model.geom_group[pairs]
        robot = (groups == _ROBOT_GROUP).any(axis=1)
        return bool((robot & (groups != _FLOOR_GROUP).all(axis=1)).any())


def _import_mujoco() -> ModuleType | Any:
    try:
        import mujoco
    except ImportError as error:
        raise ImportError(
            "the physics world needs MuJoCo: pip install slarm-graph[physics]"
        ) from error
    return mujoco
