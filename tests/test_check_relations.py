# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Relations that a trajectory misses are judged by what the scans show."""

from __future__ import annotations

import numpy as np
import pytest
from benchmark_scripts import script
from scanned_rooms import scanned_room

from slarm_graph.eval.relations import Relations
from slarm_graph.geometry import Floats, Pose2, between
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

check_relations = script("check_relations")

SCANS, AGAIN = 40, 6
CENTER = Pose2()


def driven(step: Floats) -> tuple[list[Reading], Trajectory, Relations]:
    """Scans of a way that begins anew after two minutes; a path that misses that by a step."""
    scans, path = scanned_room(0.01, 0.0)
    poses = np.concatenate([path.poses[:SCANS], path.poses[AGAIN : AGAIN + SCANS]])
    scans = [*scans[:SCANS], *scans[AGAIN : AGAIN + SCANS]]
    stamps = np.arange(2 * SCANS) * 2_000_000_000 + (np.arange(2 * SCANS) >= SCANS) * 10**11
    readings = [Reading(int(ns), s) for ns, s in zip(stamps, scans, strict=True)]
    told = np.array([[20, SCANS + 20 - AGAIN], [10, 30]])
    relations = Relations(stamps[told], between(poses[told[:, 0]], poses[told[:, 1]]))
    moved = poses.copy()
    moved[SCANS:, :2] += step[:2]
    return readings, Trajectory(stamps, moved), relations


@pytest.mark.parametrize("off_m", [-0.6, 0.6])
def test_the_relation_is_right_where_walls_say_so(off_m: float) -> None:
    readings, path, relations = driven(np.array([off_m, off_m, 0.0]))
    said = check_relations.judged(readings, relations, path, CENTER, 0.3)
    assert "right in 0, the relation in 1, no telling in 0" in said


@pytest.mark.parametrize("off_m", [-0.6, 0.6])
def test_the_trajectory_is_right_where_walls_say_so(off_m: float) -> None:
    readings, path, relations = driven(np.zeros(3))
    off = np.array([[off_m, off_m, 0.0], np.zeros(3)])
    wrong = Relations(relations.stamps_ns, relations.first_from_second + off)
    said = check_relations.judged(readings, wrong, path, CENTER, 0.3)
    assert "2 relations, 0.4243 m; 1 off by more than 0.3 m" in said
    assert "right in 1, the relation in 0, no telling in 0; 0.0000 m without" in said


def test_what_is_not_missed_is_not_asked() -> None:
    readings, path, relations = driven(np.zeros(3))
    said = check_relations.judged(readings, relations, path, CENTER, 0.3)
    assert "0 off by more than 0.3 m" in said
