# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Draws that a particle's successive proposals share."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.backends.rbpf import correlated


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_correlated_draws_stay_standard_normal_and_add_up(correlation: float) -> None:
    rng, count, updates = np.random.default_rng(0), 20_000, 100
    drawn, total = np.empty((0, 3)), np.zeros((count, 3))
    for _ in range(updates):
        before = drawn
        drawn = correlated(drawn, rng.standard_normal((count, 3)), correlation)
        total += drawn
    assert np.abs(drawn.mean(axis=0)).max() < 0.04
    assert np.allclose(np.cov(drawn.T), np.eye(3), atol=0.05)
    assert np.allclose((drawn * before).mean(axis=0), correlation, atol=0.03)
    lags = np.arange(1, updates)
    expected = updates + 2.0 * ((updates - lags) * correlation**lags).sum()
    assert np.allclose(total.var(axis=0), expected, rtol=0.05)


def test_without_correlation_draws_are_as_they_come() -> None:
    fresh = np.random.default_rng(1).standard_normal((5, 3))
    assert np.array_equal(correlated(np.ones((5, 3)), fresh, 0.0), fresh)
