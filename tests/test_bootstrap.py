# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bootstrap intervals: by every possible drawing, and by how often they hold."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from slarm_graph.eval.bootstrap import mean_interval, nested_interval, rms_interval


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(0)
    inside = 0
    for seed in range(200):
        low, high = mean_interval(rng.normal(2.0, 1.0, 60), seed=seed)
        inside += low <= 2.0 <= high
    assert 0.89 < inside / 200 < 0.99


def test_intervals_of_sources_and_seeds_are_those_of_every_possible_drawing() -> None:
    groups = [np.array([1.0, 2.0]), np.array([5.0]), np.array([7.0, 8.0, 12.0])]
    means: list[float] = []
    weights: list[float] = []
    for chosen in product(groups, repeat=3):  # 27 equally likely, each with all its inner drawings
        inner = [list(product(group, repeat=len(group))) for group in chosen]
        count = np.prod([len(drawings) for drawings in inner])
        for drawn in product(*inner):
            means.append(np.mean(np.concatenate(drawn)))
            weights.append(1.0 / 27.0 / count)
    order = np.argsort(means)
    share = np.cumsum(np.array(weights)[order])
    ends = [np.array(means)[order][np.searchsorted(share, q)] for q in (0.025, 0.975)]
    np.testing.assert_allclose(nested_interval(groups), ends, atol=0.35)
    flat = np.random.default_rng(0).normal(size=40)
    alone = [np.array([v]) for v in flat]
    np.testing.assert_allclose(nested_interval(alone), mean_interval(flat), atol=0.05)
    np.testing.assert_allclose(nested_interval([flat]), mean_interval(flat), atol=0.05)


def test_seeds_of_few_sources_do_not_feign_certainty() -> None:
    rng = np.random.default_rng(5)
    nested = pooled = 0
    for trial in range(200):
        groups = [rng.normal(rng.normal(), 0.1, 5) for _ in range(12)]
        low, high = nested_interval(groups, seed=trial)
        nested += low < 0.0 < high
        low, high = mean_interval(np.concatenate(groups), seed=trial)
        pooled += low < 0.0 < high
    assert nested > 0.82 * 200
    assert pooled < 0.65 * 200, "what would be wrong with drawing single runs"


def test_intervals_of_slow_errors_are_wider_than_those_of_white_ones() -> None:
    rng = np.random.default_rng(1)
    white = rng.normal(0, 1, 4000)
    slow = np.convolve(white, np.ones(50), mode="same") / math.sqrt(50)
    widths = [high - low for low, high in (rms_interval(white), rms_interval(slow))]
    assert widths[1] > 2 * widths[0]
