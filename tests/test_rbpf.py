# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What particles hand on to their descendants."""

from __future__ import annotations

import numpy as np

from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.config import GmappingConfig, ParticleMotionConfig, ResamplingConfig

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
