# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""All metrics of a run that its references and results allow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from slarm_graph.consistency import Contradictions
from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import align
from slarm_graph.eval.association import associate
from slarm_graph.eval.clocks import offset_advice
from slarm_graph.eval.metric_parts import References, Subject, measured_by_parts
from slarm_graph.eval.metric_table import in_table_order
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.plane_of_motion import level
from slarm_graph.eval.position_uncertainty import uncertainty_metrics
from slarm_graph.eval.relations import (
    read_relations,
    relation_errors,
    relation_metrics,
)
from slarm_graph.eval.sharpness import sharpness, sharpness_metrics
from slarm_graph.eval.trajectory_metrics import trajectory_metrics
from slarm_graph.files.trajectories import read_spatial
from slarm_graph.geometry import Pose2
from slarm_graph.trajectory import Trajectory


def read_references(ground_truth: Path | None, relations: Path | None) -> References:
    """Read the given reference files.

    Raises
    ------
    BadInput
        Naming file and line that cannot be read.
    """
    return References(
        level(read_spatial(ground_truth)) if ground_truth else None,
        read_relations(relations) if relations else None,
    )


def drop_other_times(
    known: References, trajectory: Trajectory, robot_from_laser: Pose2
) -> tuple[References, tuple[str, ...]]:
    """Drop references of another time than the trajectory's, with a notice for each.

    Parameters
    ----------
    known : References
    trajectory : Trajectory
    robot_from_laser : Pose2
    """
    notices = []
    if known.ground_truth is not None:
        try:
            associate(known.ground_truth, trajectory)
        except BadInput as error:
            known, notices = replace(known, ground_truth=None), [f"not compared: {error}"]
    if known.relations is not None:
        try:
            relation_errors(known.relations, trajectory, robot_from_laser)
        except BadInput as error:
            known, notices = replace(known, relations=None), [*notices, f"not compared: {error}"]
    return known, tuple(notices)


def assess(subject: Subject) -> tuple[Metric, ...]:
    """Return every metric that a subject allows, in the order of the table.

    Raises
    ------
    BadInput
        When trajectory and reference are not of the same time.
    """
    trajectory, known = subject.trajectory, subject.references
    metrics = list(_drive_metrics(subject))
    if known.ground_truth is not None:
        metrics += _with_clock_advice(known.ground_truth, trajectory)
    if known.relations is not None:
        errors = relation_errors(known.relations, trajectory, subject.robot_from_laser)
        metrics += relation_metrics(errors)
    if subject.consistency is not None:
        metrics += _consistency_metrics(subject.consistency)
    metrics += uncertainty_metrics(subject.covariances)
    if subject.moving_share is not None:
        note = "of the returns were left out of matching"
        metrics.append(Metric("moving_share", subject.moving_share, note=note))
    if subject.end_points_m is not None:
        metrics += sharpness_metrics(sharpness(subject.end_points_m))
    return in_table_order((*metrics, *measured_by_parts(subject)))


def _consistency_metrics(result: Contradictions) -> tuple[Metric, ...]:
    expected = f"{result.expected_share:.4f} expected" if result.compared else "nothing seen twice"
    note = f"{result.verdict}; {expected}"
    return (
        Metric("map_conflict_share", result.share, note=note),
        Metric("cross_checked_share", result.checked_share, note="of the way"),
    )


def _with_clock_advice(truth: Trajectory, trajectory: Trajectory) -> tuple[Metric, ...]:
    pairs = associate(truth, trajectory)
    advice = offset_advice(truth, trajectory, pairs)
    pairs = replace(pairs, note=f"{pairs.note}; {advice}") if advice else pairs
    return trajectory_metrics(pairs)


def _drive_metrics(subject: Subject) -> tuple[Metric, ...]:
    drive = subject.drive
    if drive is None:
        length_m = subject.trajectory.path_length_m()
        return (Metric("path_length_m", length_m, note="along the estimate"),)
    return (
        Metric("path_length_m", drive.path_length_m, note="as driven"),
        Metric("turns", float(drive.turns), note="of 45 degrees and more"),
        Metric("revisit_share", drive.revisit_share, note="of the cells entered"),
        Metric("drive_time_s", drive.drive_time_s, note="simulated"),
        Metric("collisions", float(drive.collisions), note="contacts with the true world"),
        Metric("planning_s", drive.planning_s, note="processor time"),
    )


def ground_truth_in_map(ground_truth: Trajectory, trajectory: Trajectory) -> Trajectory:
    """Return the true path aligned to the estimate, for figures.

    Raises
    ------
    BadInput
        When they are not of the same time.
    """
    truth_from_map = align(associate(ground_truth, trajectory)).reference_from_estimate
    return ground_truth.transformed(truth_from_map.inverse())
