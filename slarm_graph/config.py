# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One frozen configuration model per stage; units in the names, unknown keys refused."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator


class Stage(BaseModel):
    """Base of all configuration models."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class SourceConfig(Stage):
    """What to read from a recording."""

    scan_topic: str | None = None
    """Topic with the scans (in CARMEN logs the message name); null to choose by itself."""
    odom: str | None = None
    """Odometry topic, `tf`, `none` for scan matching only, or null to choose by itself."""
    robot_frame: str | None = None
    """Frame of the robot; null: the odometry's child frame, else base_footprint or base_link."""
    odom_frame: str | None = None
    """Frame the odometry is in, where it comes from tf; null: odom."""
    static_tf: tuple[str, ...] = ()
    """Extra fixed transforms, each `parent child x y z yaw [pitch roll]` [m, rad]."""
    segment: int | None = Field(default=None, ge=1)
    """Which part to use when the clock jumps back, counted from 1."""
    max_odom_gap_s: float | None = Field(default=None, gt=0)
    """Longest silence of the odometry that is bridged [s]; null: five times its usual spacing."""
    stamp_at: Literal["first", "middle", "last"] = "first"
    """Which beam the recorded stamps belong to; first, by the definition of the message."""
    range_min_m: float | None = None
    """Overrides the recorded range_min."""
    range_max_m: float | None = None
    """Overrides the recorded range_max; finite ranges beyond it are invalid."""
    echo: Literal["first", "last", "strongest"] = "first"
    """Which return of a beam to use, where the laser tells several apart."""
    clear_on_inf: bool = True
    """Whether +inf ranges clear the space along the beam (REP-117)."""


class MatchingConfig(Stage):
    """Matching every scan against the local map."""

    resolution_m: float = Field(default=0.05, gt=0)
    sigma_m: float = Field(default=0.04, gt=0)
    """Standard deviation of the likelihood's fall-off from what was seen."""
    point_sigma_m: float = Field(default=0.01, gt=0)
    """What one return is worth against the prediction: its error, correlations allowed for."""
    max_gap_m: float = Field(default=0.5, ge=0)
    """Neighbouring returns nearer than this are joined to a piece of wall."""
    max_iterations: int = Field(default=40, ge=1)
    min_score: float = Field(default=0.35, ge=0, le=1)
    """A match with less mean agreement has failed."""
    min_points: int = Field(default=10, ge=3)


class KeyframeConfig(Stage):
    """When a scan becomes part of the local map, and how long it stays."""

    distance_m: float = Field(default=0.25, gt=0)
    angle_rad: float = Field(default=0.25, gt=0)
    window: int = Field(default=40, ge=1)
    """The local map holds one to two windows of keyframes."""


class FrontendConfig(Stage):
    """The shared scan frontend."""

    max_range_m: float = Field(default=30.0, gt=0)
    deskew: bool = True
    point_spacing_m: float = Field(default=0.02, ge=0)
    """Returns denser than this along the beam order are thinned for matching."""
    matching: MatchingConfig = MatchingConfig()
    keyframes: KeyframeConfig = KeyframeConfig()


class LoopClosureConfig(Stage):
    """Finding old places again."""

    candidates: int = Field(default=1, ge=0)
    """Old submaps compared with a keyframe where the graph is sure of its place."""
    match_every: int = Field(default=4, ge=1)
    """Keyframes between two that are compared so."""
    searches: int = Field(default=3, ge=0)
    """Old submaps searched at a time where it is not."""
    search_every: int = Field(default=4, ge=1)
    """Keyframes between searches."""
    search_again: int = Field(default=40, ge=1)
    """Keyframes until the same old submap is searched again."""
    search_resolution_m: float = Field(default=0.1, gt=0)
    search_sigma_m: float = Field(default=0.1, gt=0)
    search_score: float = Field(default=0.55, ge=0, le=1)
    """Agreement a search must reach to be looked at closer."""
    query_keyframes: int = Field(default=8, ge=1)
    """Latest keyframes whose points are searched for together."""
    window_m: float = Field(default=12.0, gt=0)
    window_rad: float = Field(default=3.15, gt=0)
    """Largest search window to either side; within it the uncertainty decides."""
    sure_m: float = Field(default=0.2, gt=0)
    sure_rad: float = Field(default=0.07, gt=0)
    """Standard deviations up to which the predicted pose needs no search."""
    min_score: float = Field(default=0.5, ge=0, le=1)
    """Agreement a refined match must reach."""
    max_sigma_m: float = Field(default=0.15, gt=0)
    """A match less certain than this in any direction closes no loop."""
    confirm_m: float = Field(default=1.0, ge=0)
    """Way to the second match that confirms a searched one; from one place both could err alike."""


class PoseGraphConfig(Stage):
    """The GTSAM pose graph."""

    node_keyframes: int = Field(default=10, ge=2)
    """Keyframes per submap node of the graph that is kept up while driving."""
    submap_keyframes: int = Field(default=20, ge=2)
    """Keyframes a submap is made of."""
    recent_keyframes: int = Field(default=40, ge=1)
    """Submaps with younger keyframes than this are no old places."""
    loops: LoopClosureConfig = LoopClosureConfig()


class ParticleMotionConfig(Stage):
    """Noise of the motion between updates of the particle filter, as gmapping's srr ... stt.

    The motion is the shared frontend's lidar odometry, hence the defaults are smaller than
    gmapping's, which are those of wheels.
    """

    srr: float = Field(default=0.02, ge=0)
    """Standard deviation of the translation per metre driven [m/m]."""
    srt: float = Field(default=0.01, ge=0)
    """Of the rotation per metre driven [rad/m]."""
    str: float = Field(default=0.01, ge=0)
    """Of the translation per radian turned [m/rad]."""
    stt: float = Field(default=0.05, ge=0)
    """Of the rotation per radian turned [rad/rad]."""
    least_m: float = Field(default=0.005, gt=0)
    least_rad: float = Field(default=0.002, gt=0)
    """Standard deviations of a motion of length zero."""
    drift_rad_per_m: float = Field(default=5e-4, ge=0)
    """Standard deviation of the rotation per metre that matching gets wrong steadily [rad/m].

    No sensor is perfect: where a laser's angles are a little off, for example, matching turns the
    same way for the whole drive. Every particle supposes a drift of its own.
    """
    drift_length_m: float = Field(default=100.0, gt=0)
    """Way in which the drift changes to another one."""


class ParticleLikelihoodConfig(Stage):
    """How likely a scan is at a pose in a particle's map."""

    sigma_m: float = Field(default=0.03, gt=0)
    """Scale of the distance between a return and the wall it belongs to."""
    beam_information: float = Field(default=0.3, gt=0, le=1)
    """Share of a beam's information that neighbouring beams do not repeat."""
    ogain: float = Field(default=20.0, gt=0)
    """Log weights are divided by it, because the map's errors are shared by many scans.

    gmapping's default of 3 belongs to a likelihood in other units.
    """
    lskip: int = Field(default=0, ge=0)
    """Beams left out between two that count."""
    max_range_m: float | None = Field(default=None, gt=0)
    """gmapping's maxUrange; null: the frontend's."""
    min_points: int = Field(default=20, ge=3)
    """A scan with fewer returns does not update the filter."""


class ProposalConfig(Stage):
    """Where particles go."""

    improved: bool = True
    """Whether to draw near the scan-match peak, eq. (7)-(10), or from the motion, eq. (6)."""
    kernel_size: int = Field(default=1, ge=0)
    """Walls are looked for this many cells around a return."""
    iterations: int = Field(default=12, ge=1)
    """How often walls are looked for on the way to the peak at most."""
    lattice_radius: float = Field(default=2.9, ge=1.8, le=6)
    """Extent of the z poses around the peak in standard deviations; 2.9 gives z = 27."""


class ResamplingConfig(Stage):
    """When and how particles are resampled."""

    resample_threshold: float = Field(default=0.5, ge=0, le=1)
    """Resample when N_eff falls below this share of the particles."""
    method: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"


class ParticleMapsConfig(Stage):
    """The maps inside the filter; the final map is rendered as `mapping` says."""

    delta_m: float = Field(default=0.05, gt=0)
    """Side of a cell."""
    max_memory_mb: float = Field(default=4000.0, gt=0)
    """The run stops rather than use more for particle maps."""


class GmappingConfig(Stage):
    """The Rao-Blackwellised particle filter, with gmapping's names where they mean the same."""

    particles: int = Field(default=30, ge=1)
    linear_update_m: float = Field(default=0.5, gt=0)
    angular_update_rad: float = Field(default=0.25, gt=0)
    """The filter takes a scan after so much motion; the frontend matches those in between."""
    motion: ParticleMotionConfig = ParticleMotionConfig()
    likelihood: ParticleLikelihoodConfig = ParticleLikelihoodConfig()
    proposal: ProposalConfig = ProposalConfig()
    resampling: ResamplingConfig = ResamplingConfig()
    maps: ParticleMapsConfig = ParticleMapsConfig()


class MappingConfig(Stage):
    """Rendering scans into an occupancy grid."""

    resolution_m: float = Field(default=0.05, gt=0)
    max_range_m: float = Field(default=30.0, gt=0)
    """Beams are cut here; what lies behind stays unseen."""
    occupied_at: float = Field(default=0.25, gt=0, le=1)
    """A cell is occupied when at least this share of its visits were hits."""
    max_cells: int = Field(default=400_000_000, gt=0)


class RecoveryConfig(Stage):
    """Global geographic map recovery (GGMR)."""

    expansion_radius_m: float = Field(default=0.0, ge=0)
    """How far to keep from obstacles; where that leaves no way, what lies beyond is out of reach.

    The robot's radius gives what it can drive to.
    """
    default_height_m: float | None = Field(default=None, gt=0)
    """Height of obstacles with no better information; null means infinitely high."""
    known_sizes: tuple[tuple[float, ...], ...] = ()
    """Length, width and height [m] of obstacles that are known to stand around.

    A fourth number is the share of its bounding rectangle that an obstacle's plan fills: 1 when
    left out, 0.785 for what is round.
    """
    size_tolerance_m: float = Field(default=0.15, gt=0)
    """An obstacle has a known size when its sides, and that of a square as large, are this near."""
    robot_radius_m: float = Field(default=0.18, gt=0)
    """Where a robot of this radius fits, recovery leaves the free space alone."""
    speck_cells: int = Field(default=2, ge=0)
    """Groups of at most so many occupied cells are dropped."""
    hole_area_m2: float = Field(default=0.1, ge=0)
    """Unseen holes up to this size in free space are taken to be free."""
    straighten: bool = True
    """Whether walls are moved onto straight lines."""

    @field_validator("known_sizes")
    @classmethod
    def _whole_sizes(cls, sizes: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        for size in sizes:
            if len(size) not in (3, 4) or not all(0.0 < number < math.inf for number in size):
                raise ValueError(
                    f"{list(size)} is not a size: length, width and height in m, all positive,"
                    " and if it is not a box the share of its rectangle that it fills"
                )
            if size[3:] > (1.0,):
                raise ValueError(f"{list(size)}: the share of the rectangle is at most 1")
        return tuple((*size, 1.0) if len(size) == 3 else size for size in sizes)


class RadioConfig(Stage):
    """The radio map."""

    scenario: str = "InF-SH"
    frequency_hz: float = Field(default=3.5e9, gt=0)
    antenna_height_m: float = Field(default=0.5, gt=0)
    rician_factor_db: float = 7.0
    power_dbm: float = 20.0
    mount_radius_m: float = Field(default=0.25, ge=0)
    """Obstacles this near to an access point carry it and do not hide it."""
    gain_tolerance_db: float = Field(default=1.0, gt=0)
    """Gains at most this wrong count as right in the accuracy."""


class CheckpointConfig(Stage):
    """Saving enough to resume."""

    every_s: float = Field(default=60.0, gt=0)


class LidarConfig(Stage):
    """The simulated laser and how it is mounted."""

    beams: int = Field(default=360, ge=1)
    field_of_view_rad: float = Field(default=6.283185307179586, gt=0, le=6.283185307179586)
    """Centred on the laser's forward axis; a full circle does not repeat its first beam."""
    rate_hz: float = Field(default=10.0, gt=0)
    range_min_m: float = Field(default=0.12, ge=0)
    range_max_m: float = Field(default=8.0, gt=0)
    sigma_m: float = Field(default=0.01, ge=0)
    """Standard deviation of a range."""
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    """Pose on the robot; a yaw of pi is a laser that looks to the rear."""
    height_m: float = Field(default=0.2, ge=0)
    """Height of the plane of measurement; lower solids are not seen."""
    upside_down: bool = False
    clockwise: bool = False
    """Whether the laser reports its beams with a negative increment."""
    sweep_s: float = Field(default=0.0, ge=0)
    """Time from the first beam to one past the last; 0 takes them all at one instant."""


class WheelConfig(Stage):
    """The simulated differential drive: what the wheels turn is not what the ground passes."""

    wheel_base_m: float = Field(default=0.3, gt=0)
    wheel_base_error: float = 0.005
    """Share by which the true wheel base exceeds the one that odometry assumes."""
    left_slip: float = 0.001
    right_slip: float = -0.001
    """Share of each wheel's travel that is lost on the ground; negative for a larger wheel."""
    random_slip_m_per_sqrt_m: float = Field(default=0.004, ge=0)
    """Standard deviation of a wheel's lost travel per square root of its travel."""
    start_known: bool = True
    """Whether odometry begins at the true start pose instead of at zero."""


class SimulationConfig(Stage):
    """A simulated robot in a world."""

    engine: Literal["kinematic", "mujoco"] = "kinematic"
    """`mujoco` needs the extra `physics`."""
    body_radius_m: float = Field(default=0.18, gt=0)
    lidar: LidarConfig = LidarConfig()
    wheels: WheelConfig = WheelConfig()


class DrivingConfig(Stage):
    """How the robot drives, and how near it goes to things."""

    speed_m_s: float = Field(default=0.6, gt=0)
    turn_rate_rad_s: float = Field(default=2.0, gt=0)
    acceleration_m_s2: float = Field(default=1.0, gt=0)
    robot_radius_m: float = Field(default=0.18, gt=0)
    margin_m: float = Field(default=0.015, ge=0)
    """Kept between the body and everything seen, beyond half a driving cell."""
    grid_m: float = Field(default=0.025, gt=0, le=0.05)
    """Driving cells are at most this large whatever the resolution of the maps is."""


class ExploreConfig(Stage):
    """Closed-loop exploration of a world."""

    explorer: str = "ggmr+"
    resolution_m: float = Field(default=0.05, gt=0)
    """Side of the cells of coverage, geographic map and radio map (the paper's delta)."""
    goal: Literal["observed", "footprint"] = "footprint"
    """What `ggmr+` is after: to see everything, or to pass over everything."""
    driving: DrivingConfig = DrivingConfig()
    slam_rmse_m: float = Field(default=0.0, ge=0)
    """The rough boundary shrinks by this, half of it on each side (Algorithm 1)."""
    area: tuple[float, float, float, float] | None = None
    """Do not leave x_min, x_max, y_min, y_max [m]."""
    keep_out: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Polygons not to enter, each as (x, y) corners [m]."""
    return_to_start: bool = False
    mission_time_s: float | None = Field(default=None, gt=0)
    """Stop after this time of driving; null for when everything is known."""


class RunConfig(Stage):
    """Everything a run needs besides its source."""

    backend: str = "pose_graph"
    seed: int = Field(default=0, ge=0)
    source: SourceConfig = SourceConfig()
    frontend: FrontendConfig = FrontendConfig()
    pose_graph: PoseGraphConfig = PoseGraphConfig()
    gmapping: GmappingConfig = GmappingConfig()
    mapping: MappingConfig = MappingConfig()
    recovery: RecoveryConfig = RecoveryConfig()
    radio: RadioConfig = RadioConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    simulation: SimulationConfig = SimulationConfig()
    explore: ExploreConfig = ExploreConfig()
