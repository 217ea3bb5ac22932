# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How probable it is that a scan fits by chance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.fits import ChanceFit, chance_fit, pieces
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.geometry import Pose2


@pytest.mark.parametrize(("count", "agree"), [(5, 5), (6, 5), (8, 7), (12, 9), (20, 12)])
def test_few_things_are_not_held_for_more_than_they_can_tell(count: int, agree: int) -> None:
    """The oracle is the binomial tail: so many of the pieces agree by chance, or more."""
    chance = ChanceFit(0.3, 0.08, float(count))
    tail = math.log(binom.sf(agree - 1, count, 0.3))
    told = chance.log_density(agree / count)
    assert tail <= told + 1e-9  # Chernoff: never rarer than it is
    assert told > 1.6 * tail - 1.0  # nor all too frequent


def test_many_pieces_tell_as_the_spread_of_fits_does() -> None:
    assert ChanceFit(0.3, 0.1, 100.0).log_density(0.5) == pytest.approx(-0.5 * 2.0**2)


def test_what_fits_no_better_than_usual_by_chance_tells_nothing() -> None:
    assert ChanceFit(0.3, 0.1, 5.0).log_density(0.25) == 0.0
    assert ChanceFit(0.0, 0.1, 5.0).log_density(0.0) == 0.0


def test_a_fit_by_chance_knows_how_much_is_seen() -> None:
    wall = np.column_stack([np.linspace(-1.0, 2.0, 61), np.full(61, 2.0)])
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    local_map.add(wall, Pose2())
    found = chance_fit(wall, local_map, np.zeros(3), 0.9)
    assert found.count == pieces(wall) == pytest.approx(4.0)
