# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The words for true worlds: solids with heights, access points, and the seam to simulators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading


@dataclass(frozen=True, slots=True)
class Solid:
    """An upright prism that stands on the floor.

    Parameters
    ----------
    name : str
    corners_m : (K, 2) float64
        Convex or simple polygon, counter-clockwise, in the world's frame [m].
    height_m : float
        Top above the floor [m].
    """

    name: str
    corners_m: Floats
    height_m: float


@dataclass(frozen=True, slots=True)
class WorldMap:
    """The truth about a place.

    Parameters
    ----------
    name : str
    solids : tuple of Solid
    boundary_m : (K, 2) float64
        Counter-clockwise polygon of the inside of the outer walls [m].
    ceiling_m : float
    access_points : tuple of AccessPoint
    start : Pose2
        `world_from_robot` at the beginning.
    """

    name: str
    solids: tuple[Solid, ...]
    boundary_m: Floats
    ceiling_m: float
    access_points: tuple[AccessPoint, ...]
    start: Pose2

    def extent_m(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max of the boundary [m]."""
        low, high = np.min(self.boundary_m, axis=0), np.max(self.boundary_m, axis=0)
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """Hold a velocity until the next reading.

    Parameters
    ----------
    speed_m_s : float
        Forward speed [m/s].
    turn_rate_rad_s : float
        Counter-clockwise [rad/s].
    """

    speed_m_s: float
    turn_rate_rad_s: float


class World(Protocol):
    """A place with a robot in it that can be steered: a simulator or a physics engine."""

    def read(self) -> Reading:
        """Return the sensor reading at the present instant."""
        ...

    def drive(self, command: DriveCommand) -> None:
        """Let time pass until the next reading is due while holding the command."""
        ...

    def truth(self) -> Pose2:
        """Return `world_from_robot` at the present instant."""
        ...

    def collisions(self) -> int:
        """Return how often the body has touched a solid so far."""
        ...
