# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A run against what is known to be true: which metrics can be had, and those."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from slarm_graph.eval.association import associate
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.relations import (
    Relations,
    read_relations,
    relation_errors,
    relation_metrics,
)
from slarm_graph.eval.trajectory_accuracy import align, trajectory_metrics
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.geometry import Pose2
from slarm_graph.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class References:
    """What is known to be true.

    Parameters
    ----------
    ground_truth : Trajectory or None
        `truth_from_robot`.
    relations : Relations or None
        True poses of the laser, relative to each other.
    """

    ground_truth: Trajectory | None = None
    relations: Relations | None = None

    def or_truth(self, truth: Trajectory | None) -> References:
        """Fill in what a source knows of itself, where no ground truth is given."""
        return replace(self, ground_truth=truth) if self.ground_truth is None else self


def read_references(ground_truth: Path | None, relations: Path | None) -> References:
    """Read the files that are given.

    Raises
    ------
    BadInput
        Naming file and line that cannot be read.
    """
    return References(
        read_trajectory(ground_truth) if ground_truth else None,
        read_relations(relations) if relations else None,
    )


def assess(
    trajectory: Trajectory, references: References, robot_from_laser: Pose2
) -> tuple[Metric, ...]:
    """Return every metric of a trajectory that the references allow.

    Parameters
    ----------
    trajectory : Trajectory
        `map_from_robot`.
    references : References
    robot_from_laser : Pose2
        Where relations are evaluated [m, m, rad].

    Raises
    ------
    BadInput
        When trajectory and reference are not of the same time.
    """
    metrics = [Metric("path_length_m", trajectory.path_length_m(), "m", "along the estimate")]
    if references.ground_truth is not None:
        metrics += trajectory_metrics(associate(references.ground_truth, trajectory))
    if references.relations is not None:
        errors = relation_errors(references.relations, trajectory, robot_from_laser)
        metrics += relation_metrics(errors)
    return tuple(metrics)


def ground_truth_in_map(ground_truth: Trajectory, trajectory: Trajectory) -> Trajectory:
    """Return the true path laid onto the estimate, for pictures.

    Raises
    ------
    BadInput
        When they are not of the same time.
    """
    truth_from_map = align(associate(ground_truth, trajectory)).reference_from_estimate
    return ground_truth.transformed(truth_from_map.inverse())
