# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The Rao-Blackwellised particle filter: every particle is a path and the map that belongs to it.

Eq. (4): p(x, m | o, l) = p(m | x, o) p(x | o, l). Paths are sampled, maps follow from them.
"""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.random import Generator

from slarm_graph.backends.motion_model import draw_motion, first_drifts, next_drifts
from slarm_graph.backends.particle_filter import (
    Ancestry,
    effective_sample_size,
    normalised,
    resample,
    weighted_mean,
)
from slarm_graph.backends.particle_maps import ParticleMaps, most_tiles
from slarm_graph.backends.proposal import Measurement, next_scale_m, place_in_map, propose, weigh
from slarm_graph.config import GmappingConfig
from slarm_graph.cores import usable_cores
from slarm_graph.geometry import Floats, between, wrap_angles

TOLERANCE_RAD = 0.02
"""Heading error that a particle's map tolerates between two visits: a cell at 2.5 m."""
_FIRST_ESTIMATES = 10
"""Expectation maximisations of the scale with the first two scans: from 0.03 m, the setting, the
sixth is within a tenth of the last where the noise is 0.01 m."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Weighting and resampling at one update.

    Parameters
    ----------
    n_eff : float
        Effective sample size before resampling.
    resampled : bool
    distinct_ancestors : int
        Number of previous particles with descendants.
    common_update : int
        Last update at which all particles have a common ancestor; -1 if none.
    mean : (3,) float64
        Weighted mean pose before resampling, eq. (11) [m, m, rad].
    """

    n_eff: float
    resampled: bool
    distinct_ancestors: int
    common_update: int
    mean: Floats


@dataclass
class MappingFilter:
    """Particles with their maps, weights and ancestry.

    Parameters
    ----------
    config : GmappingConfig
    maps : ParticleMaps
    poses : (P, 3) float64
        `map_from_robot` at the last update.
    log_weights : (P,) float64
        Since the last resampling.
    log_evidence : (P,) float64
        Log likelihood of each particle's whole path.
    ancestry : Ancestry
    drifts : (P,) float64
        Heading drift of each particle per path length [rad/m].
    scale_m : float
        Scale of the distance between a return and the wall it belongs to, learned from all so far.
    learns_scale : bool
        Otherwise it is that of the settings.
    first_points : (K, 4) float64
        End points and normals of the first scan.
    origin : (3,) float64
        Where the first scan was, by the scans after it: paths are seen from there.
    selections : list of Selection
        One per update.
    """

    config: GmappingConfig
    maps: ParticleMaps
    poses: Floats
    log_weights: Floats
    log_evidence: Floats
    ancestry: Ancestry
    drifts: Floats
    scale_m: float
    learns_scale: bool = True
    first_points: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    origin: Floats = field(default_factory=lambda: np.zeros(3))
    selections: list[Selection] = field(default_factory=list)

    @staticmethod
    def empty(config: GmappingConfig) -> MappingFilter:
        """Put all particles at the map's origin, with empty maps."""
        count = config.particles
        return MappingFilter(
            config,
            ParticleMaps.empty(count, config.maps.delta_m, most_tiles(config.maps)),
            np.zeros((count, 3)),
            np.zeros(count),
            np.zeros(count),
            Ancestry(count),
            first_drifts(config.motion, count),
            config.likelihood.sigma_m,
        )

    def start(self, points: Floats) -> None:
        """Map the first scan, (K, 4) points with normals in the robot's frame."""
        self.first_points = points
        self.maps.insert(points, self.poses)
        self.ancestry.append(np.arange(len(self.poses)), self.poses)

    def step(self, measurement: Measurement, rng: Generator) -> None:
        """Propose, weigh, drift, resample where due, and insert the scan into the maps."""
        self.poses, gained = self._propose(measurement, rng)
        self._drift(measurement.path_m, rng)
        self.log_evidence = self.log_evidence + gained
        # eq. (8), tempered: scans matched to one map share its errors
        self.log_weights = self.log_weights + gained / self.config.likelihood.ogain
        self._select(rng)
        self.maps.insert(measurement.points, self.poses)

    def best(self) -> int:
        """Return the particle of the highest likelihood of the whole path."""
        return int(np.argmax(self.log_evidence))

    def find_origin(self) -> None:
        """Place the first scan in the finished map of the best particle.

        The map's frame is that of the first pose, from which the first draws turn all the others.
        """
        tolerance = np.diag([self.maps.resolution_m] * 2 + [TOLERANCE_RAD]) ** 2 / 12.0
        scan = self.first_points, self.config, self.scale_m
        self.origin = place_in_map(self.maps, self.best(), *scan, tolerance)

    def best_pose(self) -> Floats:
        """Pose (3,) of the best particle at the last update, seen from the origin."""
        return between(self.origin, self.poses[self.best()])

    def best_path(self) -> Floats:
        """Poses (U, 3) of the best particle at all updates, seen from the origin."""
        return self._from_origin(self.ancestry.path(self.best()))

    def mean_path(self) -> Floats:
        """Weighted mean (U, 3) of the paths of all particles, eq. (11), seen from the origin."""
        paths = self.ancestry.paths(np.arange(len(self.poses)))
        return self._from_origin(weighted_mean(paths, normalised(self.log_weights)))

    def _from_origin(self, path: Floats) -> Floats:
        seen = between(self.origin, path)
        seen[0] = 0.0
        return seen

    def _propose(self, measurement: Measurement, rng: Generator) -> tuple[Floats, Floats]:
        """Draw poses and the increments of the log weights, and learn the noise of returns."""
        normals = rng.standard_normal((len(self.poses), 6))
        if not self.config.proposal.improved:
            poses = draw_motion(
                self.poses, measurement.motion, measurement.motion_covariance, normals[:, :3]
            )
            return poses, weigh(self.maps, measurement.points, self.config, poses)
        if not self.selections and self.learns_scale:
            # The first draws turn the whole map against its first scan: no wider than returns ask.
            for _ in range(_FIRST_ESTIMATES):
                _, _, squares = self._draw(measurement, normals)
                self.scale_m = next_scale_m(self.scale_m, squares, 0)
        poses, gained, squares = self._draw(measurement, normals)
        if self.learns_scale:
            self.scale_m = next_scale_m(self.scale_m, squares, len(self.selections))
        return poses, gained

    def _draw(self, measurement: Measurement, normals: Floats) -> tuple[Floats, Floats, Floats]:
        """Propose for all particles, in parallel."""
        jobs = [
            _threads().submit(
                propose,
                replace(self.maps, tables=self.maps.tables[part]),
                measurement,
                self.config,
                self.scale_m,
                self.poses[part],
                normals[part],
            )
            for part in _parts(len(self.poses))
        ]
        poses, gained, squares = zip(*(job.result() for job in jobs), strict=True)
        return np.concatenate(poses), np.concatenate(gained), np.concatenate(squares)

    def _drift(self, path_m: float, rng: Generator) -> None:
        """Apply every particle's heading drift over a path length."""
        self.drifts = next_drifts(self.drifts, self.config.motion, path_m, rng)
        self.poses[:, 2] = wrap_angles(self.poses[:, 2] + self.drifts * path_m)

    def _select(self, rng: Generator) -> None:
        """Resample where N_eff has fallen below the threshold, and record ancestry and weights."""
        count, rule = len(self.poses), self.config.resampling
        weights = normalised(self.log_weights)
        mean, n_eff = weighted_mean(self.poses, weights), effective_sample_size(weights)
        ancestors = np.arange(count)
        resampled = n_eff < rule.resample_threshold * count
        if resampled:
            ancestors = resample(weights, rule.method, rng)
            self.maps.resample(ancestors)
            self.poses = self.poses[ancestors]
            self.log_evidence = self.log_evidence[ancestors]
            self.drifts = self.drifts[ancestors]
            self.log_weights = np.zeros(count)
        self.ancestry.append(ancestors, self.poses)
        distinct, common = len(np.unique(ancestors)), self.ancestry.common_update()
        self.selections.append(Selection(n_eff, resampled, distinct, common, mean))


def _parts(count: int) -> list[slice]:
    """Split particles into one slice per thread; the result does not depend on their number."""
    bounds = np.linspace(0, count, min(count, usable_cores()) + 1).astype(int)
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=usable_cores(), thread_name_prefix="particles")
