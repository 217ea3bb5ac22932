# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the laser on the robot, reduced from 3D to the plane."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan

MAX_TILT_DEG = 5.0
"""Largest accepted tilt: a beam of 10 m ends 0.9 m higher or lower, and misses walls."""
_NOTICED_TILT_DEG = 0.1
"""Least reported tilt; smaller ones are rounding: a beam of 10 m ends 2 cm off."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """A laser's pose in the robot's frame.

    Parameters
    ----------
    robot_from_laser : Pose2
    angle_sign : float
        -1 when the laser hangs upside down: its angles then count clockwise seen from above.
    tilt_deg : float
        Angle between the laser's plane and the floor.
    """

    robot_from_laser: Pose2 = field(default_factory=Pose2)
    angle_sign: float = 1.0
    tilt_deg: float = 0.0

    def scan(
        self,
        ranges_m: NDArray[np.float32],
        start_rad: float,
        step_rad: float,
        sweep_s: float,
        low_m: float,
        high_m: float,
    ) -> LaserScan:
        """Build a scan from ranges (B,), the laser's first angle and angle step, and its limits."""
        return LaserScan(
            ranges_m,
            self.angle_sign * start_rad,
            self.angle_sign * step_rad,
            low_m,
            high_m,
            self.robot_from_laser,
            sweep_s,
        )

    def describe(self, frame: str) -> list[str]:
        """Return notices on the mounting for the user."""
        told = []
        if self.angle_sign < 0:
            told.append(f"laser frame {frame} is mounted upside down (from tf)")
        if self.tilt_deg > _NOTICED_TILT_DEG:
            told.append(f"laser frame {frame} is tilted {self.tilt_deg:.1f} deg; treated as level")
        return told


def mounting_in_plane(rotation: Floats, translation_m: Floats, frame: str) -> Mounting:
    """Drop the third dimension of `robot_from_laser`.

    Parameters
    ----------
    rotation : (3, 3)
    translation_m : (3,)
    frame : str
        The laser's name, for the message.

    Raises
    ------
    BadInput
        When the laser's plane is tilted more than 5 degrees.
    """
    up = rotation[:, 2]
    tilt_deg = math.degrees(math.acos(min(1.0, abs(float(up[2])))))
    if tilt_deg > MAX_TILT_DEG:
        raise BadInput(
            f"laser frame {frame} is tilted {tilt_deg:.1f} deg about {_tilt_axis(up)}; "
            f"2D needs < {MAX_TILT_DEG:g} deg: choose a level laser with --scan"
        )
    heading = math.atan2(rotation[1, 0], rotation[0, 0])
    place = Pose2(float(translation_m[0]), float(translation_m[1]), heading)
    return Mounting(place, math.copysign(1.0, float(up[2])), tilt_deg)


def _tilt_axis(up: Floats) -> str:
    """Name the robot axis the laser is turned about."""
    return "x" if np.abs(up[1]) > np.abs(up[0]) else "y"
