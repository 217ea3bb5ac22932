# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the Rao-Blackwellised particle filter (backend `gmapping`)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from slarm_graph.config.scans import PoseGraphConfig
from slarm_graph.config.stage import Count, Reach, Resolution, Sigma, Stage


class ParticleMotionConfig(Stage):
    """Noise of the motion between updates of the particle filter, as gmapping's srr ... stt.

    The motion is the shared frontend's lidar odometry, hence the defaults are smaller than
    gmapping's, which are those of wheels.
    """

    srr: float = Field(default=0.02, ge=0)
    """Standard deviation of the translation per metre driven [m/m]."""
    srt: float = Field(default=0.01, ge=0)
    """Standard deviation of the rotation per metre driven [rad/m]."""
    str: float = Field(default=0.01, ge=0)
    """Standard deviation of the translation per radian turned [m/rad]."""
    stt: float = Field(default=0.05, ge=0)
    """Standard deviation of the rotation per radian turned [rad/rad]."""
    least_m: float = Field(default=0.005, gt=0)
    """Standard deviation of the translation of a motion of length zero."""
    least_rad: float = Field(default=0.002, gt=0)
    """Standard deviation of the rotation of a motion of length zero."""
    drift_rad_per_m: float = Field(default=5e-4, ge=0)
    """Standard deviation of the systematic heading drift of scan matching [rad/m].

    Where a laser's angles are a little off, for example, matching turns the same way for the whole
    drive. Every particle supposes a drift of its own.
    """
    drift_length_m: float = Field(default=100.0, gt=0)
    """Correlation length of the drift along the path."""


class ParticleLikelihoodConfig(Stage):
    """Likelihood of a scan at a pose in a particle's map."""

    sigma_m: Sigma = 0.03
    """Scale of the distance between a return and the wall it belongs to, at the start; from
    then on the improved proposal learns it."""
    beam_information: float = Field(default=0.3, gt=0, le=1)
    """Share of a beam's information that is independent of its neighbours."""
    ogain: float = Field(default=60.0, gt=0)
    """Divisor of the log weights, because the map's errors are shared by many scans.

    A third of it resamples three to four times as often, after which too few paths are left for
    some loops. gmapping's default of 3 belongs to a likelihood in other units.
    """
    lskip: int = Field(default=0, ge=0)
    """Beams skipped between two that are used."""
    max_range_m: Reach | None = None
    """Longest range that is used (gmapping's maxUrange); null: `frontend.max_range_m`."""
    min_points: int = Field(default=20, ge=3)
    """A scan with fewer returns does not update the filter."""


class ProposalConfig(Stage):
    """The proposal distribution, from which particles are drawn."""

    improved: bool = True
    """Whether to draw from around the scan match, eq. (7)-(10), else from the motion, eq. (6)."""
    kernel_size: int = Field(default=1, ge=0, le=100)
    """Cells around a return in which a wall is searched."""
    iterations: Count = 12
    """Maximum iterations of the scan match; each searches the walls anew."""
    lattice_radius: float = Field(default=2.9, ge=1.8, le=6)
    """Extent of the z poses around the peak in standard deviations; 2.9 gives z = 27."""


class ResamplingConfig(Stage):
    """When and how particles are resampled."""

    resample_threshold: float = Field(default=0.5, ge=0, le=1)
    """Resample when N_eff falls below this share of the particles."""
    method: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    """Method by which particles are drawn."""


class ParticleMapsConfig(Stage):
    """The particles' maps; the final map is rendered with the settings of `mapping`."""

    delta_m: Resolution = 0.05
    """Cell size of the particles' maps."""
    max_memory_mb: float = Field(default=4000.0, gt=0)
    """Maximum memory of the particles' maps; a run that needs more stops."""


class GmappingConfig(Stage):
    """The Rao-Blackwellised particle filter, with gmapping's names where they mean the same."""

    particles: int = Field(default=30, ge=1, le=100_000)
    """Number of particles, each a hypothesis of the path."""
    linear_update_m: float = Field(default=0.5, gt=0)
    """Translation between two filter updates; scans in between are only matched by the frontend."""
    angular_update_rad: float = Field(default=0.25, gt=0)
    """Rotation after which the filter is updated, too."""
    motion: ParticleMotionConfig = ParticleMotionConfig()
    likelihood: ParticleLikelihoodConfig = ParticleLikelihoodConfig()
    proposal: ProposalConfig = ProposalConfig()
    resampling: ResamplingConfig = ResamplingConfig()
    maps: ParticleMapsConfig = ParticleMapsConfig()
    places: PoseGraphConfig | None = PoseGraphConfig()
    """The pose graph that finds loop closures: where all particles missed one, the recording is
    filtered a second time; null: the particles alone, as in the paper."""
