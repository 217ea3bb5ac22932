# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion model p(x_t | x_t-1, l_t-1): a normal distribution around the measured motion.

l_t-1 is the lidar odometry of the shared frontend, which has matched every scan since the last
update, so its sigmas are those of scan matching rather than of wheels. The frontend has matched
the scan that the filter is about to weigh, so the two are not quite independent; `beam_information`
and `ogain` keep the filter from counting it twice.

Independent noise cannot represent an error that all updates share, such as that of a laser with
miscalibrated angles: particles would stay together while all of them drift in heading, and none
would be left to close a long loop. Hence each has a heading drift of its own.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.random import Generator

from slarm_graph.config import ParticleMotionConfig
from slarm_graph.geometry import Floats, compose


def motion_covariance(config: ParticleMotionConfig, path_m: float, turned_rad: float) -> Floats:
    """Covariance (3, 3) of a motion in the body frame at its end [m^2, m rad, rad^2].

    Parameters
    ----------
    config : ParticleMotionConfig
    path_m, turned_rad : float
        Path length and sum of absolute rotations.
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
        Measured pose of the robot relative to the one before [m, m, rad].
    covariance : (3, 3) float64
        Of (x, y, theta) in the body frame of the pose now.
    normals : (P, 3) float64
        Standard normal draws.
    """
    errors = normals @ np.linalg.cholesky(covariance).T
    return compose(compose(poses, motion), errors)


def first_drifts(config: ParticleMotionConfig, particles: int) -> Floats:
    """Initial heading drift (P,) [rad/m]: stratified quantiles of a normal distribution."""
    quantiles = [NormalDist().inv_cdf((i + 0.5) / particles) for i in range(particles)]
    return config.drift_rad_per_m * np.array(quantiles)


def next_drifts(
    drifts: Floats, config: ParticleMotionConfig, path_m: float, rng: Generator
) -> Floats:
    """Propagate drifts (P,) [rad/m] over a path length as an Ornstein-Uhlenbeck process."""
    decay = math.exp(-path_m / config.drift_length_m)
    fresh = config.drift_rad_per_m * rng.standard_normal(len(drifts))
    return np.asarray(decay * drifts + math.sqrt(1.0 - decay * decay) * fresh)
