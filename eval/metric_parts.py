# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The input of metrics (`Subject`), and the interface for metrics of other packages."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Protocol

from slarm_graph import parts as registry
from slarm_graph.access_points import RadioMap
from slarm_graph.consistency import Contradictions
from slarm_graph.eval.metrics import Metric, MetricKind
from slarm_graph.eval.relations import Relations
from slarm_graph.exploration.drive_report import DriveReport
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import OccupancyGrid
from slarm_graph.trajectory import Trajectory

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class References:
    """The ground truth of a run.

    Parameters
    ----------
    ground_truth : Trajectory or None
        `truth_from_robot`.
    relations : Relations or None
        True relative poses of the laser.
    """

    ground_truth: Trajectory | None = None
    relations: Relations | None = None

    def or_truth(self, truth: Trajectory | None) -> References:
        """Use the source's own ground truth where none is given."""
        return replace(self, ground_truth=truth) if self.ground_truth is None else self


@dataclass(frozen=True, slots=True)
class Subject:
    """The results of a run from which metrics are computed, as far as there are any.

    Parameters
    ----------
    trajectory : Trajectory
        `map_from_robot`.
    references : References
    robot_from_laser : Pose2
        Pose at which relations are evaluated [m, m, rad].
    end_points_m : (N, 2) float64, optional
        End points of the scans in the map [m].
    grid : OccupancyGrid, optional
    geographic : GeographicMap, optional
    radio : RadioMap, optional
    drive : DriveReport, optional
        Of an exploration.
    consistency : Contradictions, optional
        The run's verdict on itself.
    covariances : (N, 3, 3) float64, optional
        Of the poses, as the backend knows them [m, m, rad].
    moving_share : float, optional
        Share of the returns that the backend took to be on something that moves.
    """

    trajectory: Trajectory
    references: References = field(default_factory=References)
    robot_from_laser: Pose2 = field(default_factory=Pose2)
    end_points_m: Floats | None = None
    grid: OccupancyGrid | None = None
    geographic: GeographicMap | None = None
    radio: RadioMap | None = None
    drive: DriveReport | None = None
    consistency: Contradictions | None = None
    covariances: Floats | None = None
    moving_share: float | None = None


class MetricPart(Protocol):
    """Metrics of another package, under a name of the group `slarm_graph.metrics`."""

    kinds: Sequence[MetricKind]
    """Rows for the table of metrics."""

    def measure(self, subject: Subject) -> Iterable[Metric]:
        """Return the metrics that this subject allows."""
        ...


@cache
def parts() -> tuple[MetricPart, ...]:
    """Load the registered metrics of other packages; log and skip those that fail to load."""
    found: list[MetricPart] = []
    for name in registry.registered("metric"):
        try:
            found.append(registry.load("metric", name)())
        except Exception as error:
            _log.warning("%s", error)
    return tuple(found)


def measured_by_parts(subject: Subject) -> tuple[Metric, ...]:
    """Return the metrics of other packages; log and skip those that fail."""
    found: list[Metric] = []
    for part in parts():
        try:
            found += part.measure(subject)
        except Exception as error:
            _log.warning("metrics of %s failed: %s", type(part).__name__, error)
    return tuple(found)
