# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What particles hand on to their descendants."""

from __future__ import annotations

import numpy as np

from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.config import GmappingConfig, ParticleMotionConfig, ResamplingConfig
from slarm_graph.geometry import compose, invert, transform_points

PARTICLES = 40
PATH_M = 2.0


def stepped(drift_rad_per_m: float, threshold: float) -> MappingFilter:
    """A filter that took one step of which it saw nothing."""
    config = GmappingConfig(
        particles=PARTICLES,
        motion=ParticleMotionConfig(drift_rad_per_m=drift_rad_per_m),
        resampling=ResamplingConfig(resample_threshold=threshold),
    )
    particles = MappingFilter.empty(config)
    particles.log_weights = np.random.default_rng(1).normal(0.0, 2.0, PARTICLES)
    motion = np.array([PATH_M, 0.0, 0.0])
    blind = Measurement(np.empty((0, 4)), motion, 1e-6 * np.eye(3), path_m=PATH_M)
    particles.step(blind, np.random.default_rng(0))
    return particles


def test_particles_turn_by_what_they_suppose() -> None:
    still, drifting = stepped(0.0, 0.0), stepped(0.3, 0.0)
    turned = drifting.poses[:, 2] - still.poses[:, 2]
    assert np.allclose(turned, drifting.drifts * PATH_M)
    assert not still.drifts.any()


def test_a_descendant_supposes_what_its_ancestor_did() -> None:
    before, after = stepped(0.3, 0.0), stepped(0.3, 1.0)
    assert after.selections[-1].resampled
    ancestors = after.ancestry._parents[len(after.ancestry) - 1]
    assert len(np.unique(ancestors)) < PARTICLES
    assert np.array_equal(after.drifts, before.drifts[ancestors])
    assert np.array_equal(after.poses, before.poses[ancestors])


def test_weights_start_anew_after_resampling_and_only_then() -> None:
    """By brute force: what survivors were worth is in how many they are, not in their weights."""
    before, after = stepped(0.0, 0.0), stepped(0.0, 1.0)
    assert not before.selections[-1].resampled
    assert np.ptp(before.log_weights) > 1.0
    assert after.selections[-1].resampled
    assert np.array_equal(after.log_weights, np.zeros(PARTICLES))
    weights = np.exp(before.log_weights - before.log_weights.max())
    weights /= weights.sum()
    pairs = sum(w * w for w in weights.tolist())
    assert np.isclose(after.selections[-1].n_eff, 1.0 / pairs)
    assert np.isclose(before.selections[-1].n_eff, 1.0 / pairs)


def standing_in_a_room(noise_m: float, updates: int) -> MappingFilter:
    """A filter of a robot that stands in a square room and reads its walls with noise."""
    rng, still = np.random.default_rng(2), ParticleMotionConfig(drift_rad_per_m=0.0)
    particles = MappingFilter.empty(GmappingConfig(particles=PARTICLES, motion=still))
    along, side = np.linspace(-2.0, 2.0, 90), np.full(90, 2.02)
    walls = [(along, side, 0, -1), (-side, along, 1, 0), (along, -side, 0, 1), (side, along, -1, 0)]
    for update in range(updates + 1):
        points = np.concatenate(
            [
                np.stack([x, y, np.full(90, nx), np.full(90, ny)], axis=1)
                + rng.normal(0.0, noise_m, (90, 1)) * np.array([nx, ny, 0.0, 0.0])
                for x, y, nx, ny in walls
            ]
        )
        if update == 0:
            particles.start(points)
        else:
            covariance = np.diag([0.02, 0.02, 0.01]) ** 2
            particles.step(Measurement(points, np.zeros(3), covariance), rng)
    return particles


def test_the_noise_of_returns_is_learned_and_poses_are_drawn_by_it() -> None:
    """Of normal noise the most likely Cauchy scale is 0.61 of its standard deviation."""
    fine, coarse = standing_in_a_room(0.004, 40), standing_in_a_room(0.012, 40)
    assert np.isclose(fine.scale_m, 0.61 * 0.004, rtol=0.3)
    assert np.isclose(coarse.scale_m, 0.61 * 0.012, rtol=0.3)
    assert 1.5 * fine.poses[:, 0].std() < coarse.poses[:, 0].std()


def test_one_update_of_many_changes_the_learned_noise_little() -> None:
    """A tenth of what 360 returns say, which is some per cent off."""
    scales_m = [standing_in_a_room(0.012, updates).scale_m for updates in range(36, 42)]
    steps_m = np.abs(np.diff(scales_m))
    assert 0.0 < steps_m.max() < 0.015 * np.mean(scales_m)


def test_the_first_draws_are_by_the_noise_of_the_first_scans() -> None:
    """Those turn the whole map; the difference of two scans has 1.4 times the noise of one."""
    assert standing_in_a_room(0.01, 1).scale_m < 0.61 * 1.41 * 0.01


def test_the_first_scan_is_placed_by_those_after_it() -> None:
    """A map turned against its first scan turns back; all else keeps its place within it."""
    particles = standing_in_a_room(0.004, 30)
    turned = np.array([0.01, -0.006, 0.008])
    walls, normals = particles.first_points[:, :2], particles.first_points[:, 2:]
    seen = [
        transform_points(invert(turned), walls),
        transform_points(np.array([0.0, 0.0, -turned[2]]), normals),
    ]
    particles.first_points = np.concatenate(seen, axis=1)
    before = particles.best_path()
    particles.find_origin()
    after = particles.best_path()
    assert np.allclose(particles.origin, turned, atol=1.5e-3)
    assert np.array_equal(after[0], np.zeros(3))
    assert np.allclose(compose(particles.origin, after[1:]), before[1:])
    assert np.allclose(compose(particles.origin, particles.best_pose()), before[-1])
    assert np.allclose(particles.mean_path()[1:], after[1:], atol=5e-3)
