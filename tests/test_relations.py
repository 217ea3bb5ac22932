# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Relations metric: identities, the part it is evaluated at, and lines that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slarm_graph.errors import BadInput
from slarm_graph.eval.relations import (
    Relations,
    read_relations,
    relation_errors,
    relation_metrics,
    seconds_to_ns,
)
from slarm_graph.geometry import Pose2, between
from slarm_graph.trajectory import Trajectory

STAMPS = np.arange(50) * 200_000_000 + 976_052_857_000_000_000


def circle() -> Trajectory:
    angle = np.linspace(0, 5, 50)
    return Trajectory(STAMPS, np.column_stack([np.cos(angle), np.sin(angle), angle]))


def true_relations(path: Trajectory) -> Relations:
    first, second = np.arange(0, 40), np.arange(10, 50)
    return Relations(
        np.column_stack([path.stamps_ns[first], path.stamps_ns[second]]),
        between(path.poses[first], path.poses[second]),
    )


def test_the_truth_has_no_error_in_any_frame() -> None:
    errors = relation_errors(true_relations(circle()), circle().transformed(Pose2(4, 5, 6)))
    assert errors.translation_m.max() < 1e-12
    assert errors.rotation_rad.max() < 1e-12


def test_relations_of_the_laser_want_the_laser() -> None:
    robot_from_laser = Pose2(0.3, 0.0, 0.1)
    relations = true_relations(circle().moved_to(robot_from_laser))
    assert relation_errors(relations, circle(), robot_from_laser).translation_m.max() < 1e-12
    assert relation_errors(relations, circle()).translation_m.max() > 0.01


def test_a_known_error_comes_out() -> None:
    stamps = STAMPS[:2]
    relations = Relations(stamps[None, :], np.array([[1.0, 0.0, 0.0]]))
    off = Trajectory(stamps, np.array([[0.0, 0.0, 0.0], [1.03, 0.04, 0.1]]))
    values = {m.name: m.value for m in relation_metrics(relation_errors(relations, off))}
    assert values["relations_translation_m"] == pytest.approx(0.05)
    assert values["relations_rotation_deg"] == pytest.approx(np.degrees(0.1))


def test_file_round_trip_and_bad_lines(tmp_path: Path) -> None:
    file = tmp_path / "a.relations"
    file.write_text("# comment\n976052857.123456789 976052858.5 1 2 0 0 0 -3\n")
    relations = read_relations(file)
    assert relations.stamps_ns.tolist() == [[976052857123456789, 976052858500000000]]
    assert relations.first_from_second.tolist() == [[1.0, 2.0, -3.0]]
    file.write_text("1.0 2.0 3.0\n")
    with pytest.raises(BadInput, match=r"a\.relations:1: expected"):
        read_relations(file)
    file.write_text("")
    with pytest.raises(BadInput, match="no relations"):
        read_relations(file)


@pytest.mark.parametrize("outside_s", [0.0, 0.5, 0.500000001, 3.0])
def test_relations_count_up_to_half_a_second_outside_the_path(outside_s: float) -> None:
    path, off_ns = circle(), round(outside_s * 1e9)
    ends = [(path.stamps_ns[0] - off_ns, STAMPS[20]), (STAMPS[20], path.stamps_ns[-1] + off_ns)]
    inside = (STAMPS[5], STAMPS[15])
    relations = Relations(np.array([inside, *ends]), np.zeros((3, 3)))
    assert len(relation_errors(relations, path).translation_m) == (3 if outside_s <= 0.5 else 1)


def test_another_recording_is_refused() -> None:
    later = Trajectory(STAMPS + 10**15, circle().poses)
    with pytest.raises(BadInput, match="same recording"):
        relation_errors(true_relations(circle()), later)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1.5", 1_500_000_000),
        ("976052857.337284", 976052857337284000),
        ("2", 2 * 10**9),
        ("1e1", 10**10),
        ("-0.5", -500_000_000),
    ],
)
def test_seconds_become_exact_nanoseconds(text: str, expected: int) -> None:
    assert seconds_to_ns(text) == expected
