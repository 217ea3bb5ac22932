# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Weights, resampling and ancestry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slarm_graph.backends.particle_filter import (
    Ancestry,
    effective_sample_size,
    normalised,
    resample,
    weighted_mean,
)
from slarm_graph.geometry import wrap_angles

METHODS = ("systematic", "stratified", "residual", "multinomial")
WEIGHTS = np.array([0.02, 0.4, 0.03, 0.25, 0.3])


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
def test_weights_sum_to_one_whatever_their_logs(logs: list[float]) -> None:
    weights = normalised(np.array(logs))
    assert np.isclose(weights.sum(), 1.0)
    n_eff = effective_sample_size(weights)
    assert 1.0 - 1e-9 <= n_eff <= len(logs) + 1e-9


def test_n_eff_of_equal_weights_is_their_number() -> None:
    assert np.isclose(effective_sample_size(normalised(np.full(30, -1234.5))), 30.0)
    assert np.isclose(effective_sample_size(normalised(np.array([0.0, -1e5]))), 1.0)


@given(st.lists(st.integers(1, 50), min_size=1, max_size=12))
def test_n_eff_is_the_number_of_distinct_draws_in_pairs(counts: list[int]) -> None:
    """Brute force: two draws by weight are the same particle with probability 1 / N_eff."""
    of = np.repeat(np.arange(len(counts)), counts)
    same = (of[:, None] == of[None]).mean()
    weights = np.array(counts) / sum(counts)
    assert effective_sample_size(weights) == pytest.approx(1.0 / same)


@pytest.mark.parametrize("method", METHODS)
def test_resampling_is_unbiased(method: str) -> None:
    rng, runs, count = np.random.default_rng(5), 4000, len(WEIGHTS)
    copies = np.array(
        [np.bincount(resample(WEIGHTS, method, rng), minlength=count) for _ in range(runs)]
    )
    assert (copies.sum(axis=1) == count).all()
    # No method spreads more than the multinomial does.
    sigma = np.sqrt(count * WEIGHTS * (1.0 - WEIGHTS) / runs)
    assert (np.abs(copies.mean(axis=0) - count * WEIGHTS) < 4.0 * sigma).all()


def test_systematic_resampling_keeps_to_the_nearest_numbers() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        copies = np.bincount(resample(WEIGHTS, "systematic", rng), minlength=len(WEIGHTS))
        assert (np.abs(copies - len(WEIGHTS) * WEIGHTS) < 1.0).all()


@pytest.mark.parametrize("method", METHODS)
def test_resampling_depends_on_the_generator_alone(method: str) -> None:
    np.random.seed(1)  # noqa: NPY002
    first = resample(WEIGHTS, method, np.random.default_rng(3))
    untouched = np.random.random()  # noqa: NPY002
    np.random.seed(1)  # noqa: NPY002
    assert np.random.random() == untouched  # noqa: NPY002
    assert np.array_equal(first, resample(WEIGHTS, method, np.random.default_rng(3)))


@pytest.mark.parametrize("method", METHODS)
def test_rounding_loses_no_particle(method: str) -> None:
    rng = np.random.default_rng(0)
    for count in (1, 3, 7, 300):
        weights = normalised(rng.normal(0.0, 5.0, count))
        for _ in range(20):
            assert len(resample(weights, method, rng)) == count


def test_eq_11_weighted_mean_is_circular() -> None:
    poses = np.array([[0.0, 0.0, np.pi - 0.1], [2.0, 4.0, -np.pi + 0.1]])
    mean = weighted_mean(poses, np.array([0.5, 0.5]))
    assert np.allclose(mean[:2], [1.0, 2.0])
    assert np.isclose(abs(mean[2]), np.pi)
    assert np.allclose(weighted_mean(poses, np.array([1.0, 0.0])), poses[0])


def test_ancestry_equals_copied_paths() -> None:
    rng, particles = np.random.default_rng(2), 7
    tree, copies = Ancestry(particles), np.empty((0, particles, 3))
    for update in range(150):
        parents = np.arange(particles)
        if update % 3 == 0:
            parents = rng.integers(0, particles, particles)
        poses = wrap_angles(rng.normal(size=(particles, 3)))
        copies = np.concatenate([copies[:, parents], poses[None]])
        tree.append(parents, poses)
    assert len(tree) == 150
    assert np.array_equal(tree.paths(np.arange(particles)), copies)
    assert np.array_equal(tree.path(3), copies[:, 3])
    same = (copies == copies[:, :1]).all(axis=(1, 2))
    assert tree.common_update() == np.flatnonzero(same)[-1]


def test_particles_of_different_origin_have_no_common_update() -> None:
    tree = Ancestry(2)
    tree.append(np.array([0, 1]), np.zeros((2, 3)))
    assert tree.common_update() == -1
    tree.append(np.array([1, 1]), np.zeros((2, 3)))
    assert tree.common_update() == 0


def test_residual_resampling_draws_only_what_whole_copies_leave() -> None:
    rng = np.random.default_rng(1)
    whole = resample(np.array([0.5, 0.0, 0.25, 0.25]), "residual", rng)
    assert sorted(whole.tolist()) == [0, 0, 2, 3]
    drawn = set()
    for _ in range(60):
        copies = np.bincount(resample(WEIGHTS, "residual", rng), minlength=len(WEIGHTS))
        assert (copies >= np.floor(len(WEIGHTS) * WEIGHTS)).all()
        drawn |= set(np.flatnonzero(copies > np.floor(len(WEIGHTS) * WEIGHTS)).tolist())
    # What is left of 0.1, 2.0, 0.15, 1.25 and 1.5: nothing of the second.
    assert drawn == {0, 2, 3, 4}
