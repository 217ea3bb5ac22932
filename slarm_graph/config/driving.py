# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulated robot, and how it explores."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from slarm_graph.config.sections import PartName
from slarm_graph.config.stage import MOST_BEAMS, Reach, Resolution, Stage


class LidarConfig(Stage):
    """The simulated laser and how it is mounted."""

    beams: int = Field(default=360, ge=1, le=MOST_BEAMS)
    """Beams of a sweep."""
    field_of_view_rad: float = Field(default=6.283185307179586, gt=0, le=6.283185307179586)
    """Centred on the laser's forward axis; a full circle does not repeat its first beam."""
    rate_hz: float = Field(default=10.0, ge=0.01, le=1000)
    """Sweeps per second."""
    range_min_m: float = Field(default=0.12, ge=0)
    """Nearer things are not seen."""
    range_max_m: Reach = 8.0
    """Farther things are not seen."""
    sigma_m: float = Field(default=0.01, ge=0)
    """Standard deviation of a range."""
    x_m: float = 0.0
    """Position on the robot, forwards."""
    y_m: float = 0.0
    """Position on the robot, to the left."""
    yaw_rad: float = 0.0
    """Heading on the robot; pi is a laser that looks to the rear."""
    height_m: float = Field(default=0.2, ge=0)
    """Height of the plane of measurement; lower solids are not seen."""
    upside_down: bool = False
    """Whether it hangs with its top down."""
    clockwise: bool = False
    """Whether the laser reports its beams with a negative increment."""
    sweep_s: float = Field(default=0.0, ge=0, le=100)
    """Time from the first beam to one past the last; 0 takes them all at one instant."""


class WheelConfig(Stage):
    """The simulated differential drive: what the wheels turn is not what the ground passes."""

    wheel_base_m: float = Field(default=0.3, ge=0.001, le=100)
    """Distance between the wheels that odometry assumes."""
    wheel_base_error: float = 0.005
    """Share by which the true wheel base exceeds the one that odometry assumes."""
    left_slip: float = 0.001
    """Share of the left wheel's travel that is lost on the ground; negative: a larger wheel."""
    right_slip: float = -0.001
    """Share of the right wheel's travel that is lost on the ground."""
    random_slip_m_per_sqrt_m: float = Field(default=0.004, ge=0)
    """Standard deviation of a wheel's lost travel per square root of its travel."""
    start_known: bool = True
    """Whether odometry begins at the true start pose instead of at zero."""


class SignalConfig(Stage):
    """What a receiver on the simulated robot hears of the world's access points."""

    rate_hz: float = Field(default=0.0, ge=0, le=1000)
    """Readings per second of every access point, at most one a sweep; 0 hears nothing."""
    exponent: float = Field(default=2.0, gt=0)
    """n of 10 n log10(d); the first metre is that of free space."""
    wall_db: float = Field(default=5.0, ge=0)
    """Loss of every wall or obstacle that the straight segment passes (COST 231: 3.4 to 6.9)."""
    shadowing_db: float = Field(default=4.0, ge=0)
    """Standard deviation of log-normal shadowing (TR 38.901, Table 7.5-6: 3 to 8 dB indoors)."""
    shadowing_m: float = Field(default=2.0, gt=0)
    """Where its correlation has fallen to 1/e (Gudmundson 1991)."""
    rician_factor_db: float = 7.0
    """Power of the direct path over that of all others where nothing is passed; else none."""
    fades: int = Field(default=4, ge=1, le=1000)
    """Independent fades that a reading averages: a channel of 20 MHz over a coherence bandwidth of
    some 5 MHz indoors."""
    threshold_dbm: float = -90.0
    """What is weaker is not heard."""
    quantum_db: float = Field(default=1.0, ge=0)
    """Readings are multiples of this; 0 does not round."""


class SimulationConfig(Stage):
    """A simulated robot in a world."""

    engine: Literal["kinematic", "mujoco"] = "kinematic"
    """`mujoco` needs the extra `physics`."""
    body_radius_m: float = Field(default=0.18, gt=0, le=10)
    """Radius of the robot, which is round; its contacts are collisions."""
    lidar: LidarConfig = LidarConfig()
    wheels: WheelConfig = WheelConfig()
    signals: SignalConfig = SignalConfig()


class DrivingConfig(Stage):
    """How the robot drives, and how near it goes to things."""

    speed_m_s: float = Field(default=0.6, ge=0.001, le=100)
    """Speed of travel on free ground."""
    turn_rate_rad_s: float = Field(default=2.0, gt=0)
    """Fastest turn."""
    acceleration_m_s2: float = Field(default=1.0, gt=0)
    """Acceleration of travel and of braking."""
    robot_radius_m: float = Field(default=0.18, gt=0, le=10)
    """Radius of the body that has to fit."""
    margin_m: float = Field(default=0.015, ge=0)
    """Kept between the body and everything seen, beyond half a driving cell."""
    grid_m: float = Field(default=0.025, ge=0.001, le=0.05)
    """Driving cells are at most this large whatever the resolution of the maps is."""


class ExploreConfig(Stage):
    """Closed-loop exploration of a world."""

    explorer: Annotated[str, PartName("explorer")] = "ggmr+"
    """Who decides where to drive."""
    resolution_m: Resolution = 0.05
    """Side of the cells of coverage, geographic map and radio map (the paper's delta)."""
    driving: DrivingConfig = DrivingConfig()
    prior: Literal["extent", "extent+sizes"] = "extent+sizes"
    """What the robot is told of a world before it starts, beside its start and the access points:
    the rough extent and the ceiling, and as in the paper's Algorithm 1 also the length, width and
    height of every wall and obstacle, not where they stand. Accuracy is reported for both."""
    judge_variants: bool = False
    """Also report the accuracy of the same drive with R_e of one cell, of the robot's radius and
    of zero, each with and without sizes (for the paper's figure 5)."""
    slam_rmse_m: float | None = Field(default=None, ge=0)
    """The rough boundary shrinks by this, half of it on each side (Algorithm 1); null takes the
    root mean square of what the SLAM stage itself says of its positions, so far as it does."""
    area: tuple[float, float, float, float] | None = None
    """Do not leave x_min, x_max, y_min, y_max [m]."""
    keep_out: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Polygons not to enter, each as (x, y) corners [m]."""
    return_to_start: bool = False
    """Whether to drive home in the end."""
    mission_time_s: float | None = Field(default=None, gt=0)
    """Stop after this time of driving; null for when everything is known."""
