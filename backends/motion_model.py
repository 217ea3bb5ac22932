# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion model p(x_t | x_t-1, l_t-1): a normal distribution around the measured motion.

l_t-1 is the lidar odometry of the shared frontend, which has matched every scan since the last
update, so its sigmas are those of scan matching rather than of wheels. As the frontend has seen
the scan that the filter is about to weigh, the two are not quite independent; `beam_information`
and `ogain` keep the filter from being sure of itself twice.

Neither draws nor weights of independent updates know of an error that all of them share, such as
that of a laser whose angles are a little off: particles would stay together while all of them turn
away, and none would be there to close a long loop. Hence each supposes a steady drift of its own.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.random import Generator

from slarm_graph.config import ParticleMotionConfig
from slarm_graph.geometry import Floats, compose


def motion_covariance(config: ParticleMotionConfig, path_m: float, turned_rad: float) -> Floats:
    """Covariance (3, 3) of a motion in the body frame it leads to [m^2, m rad, rad^2].

    Parameters
    ----------
    config : ParticleMotionConfig
    path_m, turned_rad : float
        Length of the way and sum of the absolute turns, forth and back counted.
    """
    position_m = config.least_m + config.srr * path_m + config.str * turned_rad
    heading_rad = config.least_rad + config.srt * path_m + config.stt * turned_rad
    return np.diag([position_m, position_m, heading_rad]) ** 2


def draw_motion(poses: Floats, motion: Floats, covariance: Floats, normals: Floats) -> Floats:
    """Draw poses (P, 3) from p(x_t | x_t-1, l_t-1), the proposal of eq. (6).

    Parameters
    ----------
    poses : (P, 3) float64
        Of the particles before the motion.
    motion : (3,) float64
        Measured pose of the robot now in its frame before [m, m, rad].
    covariance : (3, 3) float64
        Of (x, y, theta) in the body frame of the pose now.
    normals : (P, 3) float64
        Standard normal draws.
    """
    errors = normals @ np.linalg.cholesky(covariance).T
    return compose(compose(poses, motion), errors)


def first_drifts(config: ParticleMotionConfig, particles: int) -> Floats:
    """Drift (P,) [rad/m] of every particle: the quantiles of a normal distribution, no gaps."""
    quantiles = [NormalDist().inv_cdf((i + 0.5) / particles) for i in range(particles)]
    return config.drift_rad_per_m * np.array(quantiles)


def next_drifts(
    drifts: Floats, config: ParticleMotionConfig, path_m: float, rng: Generator
) -> Floats:
    """Let drifts (P,) [rad/m] change along a way: an Ornstein-Uhlenbeck process of its length."""
    kept = math.exp(-path_m / config.drift_length_m)
    fresh = config.drift_rad_per_m * rng.standard_normal(len(drifts))
    return np.asarray(kept * drifts + math.sqrt(1.0 - kept * kept) * fresh)
