# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The bound on what readings can tell of a field: by hand, and by regression of drawn fields."""

from __future__ import annotations

import numpy as np
import pytest
from benchmark_scripts import script

for needed in ("known_pose", "bench_simulated_radio"):
    script(needed)
kriging_sd_db = script("radio_bound").kriging_sd_db


def test_one_reading_by_hand():
    """At a distance d a reading of variance f^2 + n^2 takes f^4 exp(-2 d / r) / (f^2 + n^2)."""
    away, field, noise, reach = 1.5, 4.0, 2.0, 3.0
    left = field**2 - field**4 * np.exp(-2.0 * away / reach) / (field**2 + noise**2)
    told = kriging_sd_db(np.array([[away, 0.0]]), np.zeros((1, 2)), noise, field, reach)
    assert told == pytest.approx(np.sqrt(left))


def test_no_linear_estimate_of_drawn_fields_has_less_error():
    rng = np.random.default_rng(0)
    heard, probes = rng.uniform(0.0, 5.0, (12, 2)), rng.uniform(0.0, 5.0, (9, 2))
    both = np.concatenate([heard, probes])
    away = np.linalg.norm(both[:, None] - both[None], axis=2)
    field = rng.multivariate_normal(np.zeros(21), 16.0 * np.exp(-away / 2.0), 40_000)
    told = field[:, :12] + 1.5 * rng.standard_normal((40_000, 12))
    weights = np.linalg.lstsq(told, field[:, 12:], rcond=None)[0]
    error = np.sqrt(np.mean((told @ weights - field[:, 12:]) ** 2))
    assert kriging_sd_db(probes, heard, 1.5, 4.0, 2.0) == pytest.approx(error, rel=0.01)
