# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the simulated robot and of closed-loop exploration."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from slarm_graph.config.sections import PartName
from slarm_graph.config.stage import MOST_BEAMS, Reach, Resolution, Stage


class LidarConfig(Stage):
    """The simulated laser and how it is mounted."""

    beams: int = Field(default=360, ge=1, le=MOST_BEAMS)
    """Beams per sweep."""
    field_of_view_rad: float = Field(default=6.283185307179586, gt=0, le=6.283185307179586)
    """Centred on the laser's forward axis; a full circle does not repeat its first beam."""
    rate_hz: float = Field(default=10.0, ge=0.01, le=1000)
    """Sweeps per second."""
    range_min_m: float = Field(default=0.12, ge=0)
    """Shortest range that is measured."""
    range_max_m: Reach = 8.0
    """Longest range that is measured."""
    sigma_m: float = Field(default=0.01, ge=0)
    """Standard deviation of the range noise."""
    x_m: float = 0.0
    """Mounting position in the robot frame, forwards."""
    y_m: float = 0.0
    """Mounting position in the robot frame, to the left."""
    yaw_rad: float = 0.0
    """Mounting angle in the robot frame; pi: the laser looks to the rear."""
    height_m: float = Field(default=0.2, ge=0)
    """Height of the scan plane above the floor; lower solids are not seen."""
    upside_down: bool = False
    """Whether the laser is mounted upside down."""
    clockwise: bool = False
    """Whether the laser reports its beams clockwise, with a negative increment."""
    sweep_s: float = Field(default=0.0, ge=0, le=100)
    """Duration of a sweep, from the first beam to one past the last; 0: all at one instant."""


class WheelConfig(Stage):
    """The simulated differential drive, with errors of its odometry."""

    wheel_base_m: float = Field(default=0.3, ge=0.001, le=100)
    """Wheel base that odometry assumes."""
    wheel_base_error: float = 0.005
    """Share by which the true wheel base exceeds the one that odometry assumes."""
    left_slip: float = 0.001
    """Share of the left wheel's travel that is lost by slip; negative: a larger wheel."""
    right_slip: float = -0.001
    """Share of the right wheel's travel that is lost by slip."""
    random_slip_m_per_sqrt_m: float = Field(default=0.004, ge=0)
    """Standard deviation of a wheel's random slip per square root of its travel."""
    start_known: bool = True
    """Whether odometry begins at the true start pose instead of at zero."""


class SignalConfig(Stage):
    """Signal strength of the world's access points, measured by the simulated robot."""

    rate_hz: float = Field(default=0.0, ge=0, le=1000)
    """Readings per second and access point, at most one per sweep; 0: none."""
    exponent: float = Field(default=2.0, gt=0)
    """Path-loss exponent n of 10 n log10(d); free space up to one metre."""
    wall_db: float = Field(default=5.0, ge=0)
    """Loss per wall or obstacle on the direct path (COST 231: 3.4 to 6.9)."""
    shadowing_db: float = Field(default=4.0, ge=0)
    """Standard deviation of log-normal shadowing (TR 38.901, Table 7.5-6: 3 to 8 dB indoors)."""
    shadowing_m: float = Field(default=2.0, gt=0)
    """Decorrelation distance of shadowing, where its correlation is 1/e (Gudmundson 1991)."""
    rician_factor_db: float = 7.0
    """Rician K factor in line of sight; without, fading is Rayleigh."""
    fades: int = Field(default=4, ge=1, le=1000)
    """Independent fades averaged by a reading: a channel of 20 MHz over a coherence bandwidth of
    some 5 MHz indoors."""
    threshold_dbm: float = -90.0
    """Sensitivity of the receiver: weaker signals are not heard."""
    quantum_db: float = Field(default=1.0, ge=0)
    """Step to which readings are rounded; 0: not rounded."""


class SimulationConfig(Stage):
    """A simulated robot in a world."""

    engine: Literal["kinematic", "mujoco"] = "kinematic"
    """Physics of the simulation; `mujoco` needs the extra `physics`."""
    body_radius_m: float = Field(default=0.18, gt=0, le=10)
    """Radius of the round robot; its contacts count as collisions."""
    lidar: LidarConfig = LidarConfig()
    wheels: WheelConfig = WheelConfig()
    signals: SignalConfig = SignalConfig()


class DrivingConfig(Stage):
    """Speeds of the robot and its distance to obstacles."""

    speed_m_s: float = Field(default=0.6, ge=0.001, le=100)
    """Driving speed."""
    turn_rate_rad_s: float = Field(default=2.0, gt=0)
    """Largest turn rate."""
    acceleration_m_s2: float = Field(default=1.0, gt=0)
    """Acceleration, also of braking."""
    robot_radius_m: float = Field(default=0.18, gt=0, le=10)
    """Radius of the robot in path planning."""
    margin_m: float = Field(default=0.015, ge=0)
    """Clearance between robot and obstacles, beyond half a driving cell."""
    grid_m: float = Field(default=0.025, ge=0.001, le=0.05)
    """Largest cell size of the grid for driving, whatever the resolution of the maps."""


class ExploreConfig(Stage):
    """Closed-loop exploration of a world."""

    explorer: Annotated[str, PartName("explorer")] = "ggmr+"
    """Exploration method, which chooses where to drive."""
    resolution_m: Resolution = 0.05
    """Cell size of coverage, geographic map and radio map (the paper's delta)."""
    driving: DrivingConfig = DrivingConfig()
    prior: Literal["extent", "extent+sizes"] = "extent+sizes"
    """What the robot knows of a world beforehand, beside its start and the access points: the rough
    extent and the ceiling, and as in the paper's Algorithm 1 also the length, width and height of
    every wall and obstacle, not where they stand. Accuracy is reported for both."""
    judge_variants: bool = False
    """Whether to report also the accuracy of the same drive with R_e of one cell, of the robot's
    radius and of zero, each with and without sizes (for the paper's figure 5)."""
    slam_rmse_m: float | None = Field(default=None, ge=0)
    """RMSE of the SLAM stage, by which the rough boundary shrinks, half of it on each side
    (Algorithm 1); null: what the SLAM stage itself estimates, where it does."""
    area: tuple[float, float, float, float] | None = None
    """Area that the robot must not leave: x_min, x_max, y_min, y_max [m]."""
    keep_out: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Polygons that the robot must not enter, each as (x, y) corners [m]."""
    return_to_start: bool = False
    """Whether the robot drives back to its start in the end."""
    mission_time_s: float | None = Field(default=None, gt=0)
    """Driving time after which exploration stops; null: no limit."""
