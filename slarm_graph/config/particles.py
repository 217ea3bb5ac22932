# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The Rao-Blackwellised particle filter."""

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
    """Of the rotation per metre driven [rad/m]."""
    str: float = Field(default=0.01, ge=0)
    """Of the translation per radian turned [m/rad]."""
    stt: float = Field(default=0.05, ge=0)
    """Of the rotation per radian turned [rad/rad]."""
    least_m: float = Field(default=0.005, gt=0)
    """Standard deviation of the translation of a motion of length zero."""
    least_rad: float = Field(default=0.002, gt=0)
    """Standard deviation of the rotation of a motion of length zero."""
    drift_rad_per_m: float = Field(default=5e-4, ge=0)
    """Standard deviation of the rotation per metre that matching gets wrong steadily [rad/m].

    No sensor is perfect: where a laser's angles are a little off, for example, matching turns the
    same way for the whole drive. Every particle supposes a drift of its own.
    """
    drift_length_m: float = Field(default=100.0, gt=0)
    """Way in which the drift changes to another one."""


class ParticleLikelihoodConfig(Stage):
    """How likely a scan is at a pose in a particle's map."""

    sigma_m: Sigma = 0.03
    """Scale of the distance between a return and the wall it belongs to."""
    beam_information: float = Field(default=0.3, gt=0, le=1)
    """Share of a beam's information that neighbouring beams do not repeat."""
    ogain: float = Field(default=20.0, gt=0)
    """Log weights are divided by it, because the map's errors are shared by many scans.

    gmapping's default of 3 belongs to a likelihood in other units.
    """
    lskip: int = Field(default=0, ge=0)
    """Beams left out between two that count."""
    max_range_m: Reach | None = None
    """gmapping's maxUrange; null: the frontend's."""
    min_points: int = Field(default=20, ge=3)
    """A scan with fewer returns does not update the filter."""


class ProposalConfig(Stage):
    """Where particles go."""

    improved: bool = True
    """Whether to draw near the scan-match peak, eq. (7)-(10), or from the motion, eq. (6)."""
    kernel_size: int = Field(default=1, ge=0, le=100)
    """Walls are looked for this many cells around a return."""
    iterations: Count = 12
    """How often walls are looked for on the way to the peak at most."""
    lattice_radius: float = Field(default=2.9, ge=1.8, le=6)
    """Extent of the z poses around the peak in standard deviations; 2.9 gives z = 27."""


class ResamplingConfig(Stage):
    """When and how particles are resampled."""

    resample_threshold: float = Field(default=0.5, ge=0, le=1)
    """Resample when N_eff falls below this share of the particles."""
    method: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    """How survivors are drawn."""


class ParticleMapsConfig(Stage):
    """The maps inside the filter; the final map is rendered as `mapping` says."""

    delta_m: Resolution = 0.05
    """Side of a cell."""
    max_memory_mb: float = Field(default=4000.0, gt=0)
    """The run stops rather than use more for particle maps."""


class GmappingConfig(Stage):
    """The Rao-Blackwellised particle filter, with gmapping's names where they mean the same."""

    particles: int = Field(default=30, ge=1, le=100_000)
    """Hypotheses of the path."""
    linear_update_m: float = Field(default=0.5, gt=0)
    """The filter takes a scan after so much translation; the frontend matches those in between."""
    angular_update_rad: float = Field(default=0.25, gt=0)
    """The filter takes a scan after so much rotation, too."""
    motion: ParticleMotionConfig = ParticleMotionConfig()
    likelihood: ParticleLikelihoodConfig = ParticleLikelihoodConfig()
    proposal: ProposalConfig = ProposalConfig()
    resampling: ResamplingConfig = ResamplingConfig()
    maps: ParticleMapsConfig = ParticleMapsConfig()
    places: PoseGraphConfig | None = PoseGraphConfig()
    """The graph that recognises old places: where every particle has missed a loop, the filter goes
    over the recording a second time; null: the particles alone, as in the paper."""
