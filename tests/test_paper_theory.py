# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the paper's figures would be without SLAM error."""

from __future__ import annotations

import pytest

from slarm_graph.config import DrivingConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.paper.theory import mission_accuracy, one_cell_ring_accuracy

# From an independent model of the room without SLAM.
RING_PERCENT = {0.02: 97.1, 0.05: 92.7, 0.10: 85.2, 0.20: 68.6, 0.25: 64.3}


@pytest.mark.parametrize(("resolution_m", "percent"), RING_PERCENT.items())
def test_a_ring_of_one_cell_costs_what_the_model_says(resolution_m: float, percent: float) -> None:
    found = 100.0 * one_cell_ring_accuracy(load_world("paper_room"), resolution_m)
    assert found == pytest.approx(percent, abs=0.05)


def test_a_mission_without_end_leaves_only_the_ring() -> None:
    room = load_world("paper_room")
    whole = mission_accuracy(room, 0.25, DrivingConfig(), 1e9)
    assert whole == pytest.approx(one_cell_ring_accuracy(room, 0.25))
    assert mission_accuracy(room, 0.25, DrivingConfig(), 100.0) < 0.9 * whole
