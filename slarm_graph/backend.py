# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The seam of the house: readings in, poses out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from slarm_graph.constraint import PoseGraph
from slarm_graph.geometry import Floats, Pose2, compose
from slarm_graph.readings import Reading
from slarm_graph.snapshots import State
from slarm_graph.trajectory import Trajectory

PATH_COLUMNS = ("stamp_ns", "x_m", "y_m", "theta_rad")
"""Of a table that is a path in the map."""
Heartbeat = Callable[[str], None]
"""Told in words what a long step is doing, so that progress stays alive."""


def silent(_message: str) -> None:
    """Ignore a heartbeat."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows a backend wants shown and written as `<name>.csv`, such as its loop closures.

    Parameters
    ----------
    name : str
        File stem.
    columns : tuple of str
        Names with units.
    rows : tuple of tuple
    """

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[float | int | str, ...], ...]

    def path(self) -> Trajectory | None:
        """Return the path in the map that the table is; None where it is none."""
        if self.columns != PATH_COLUMNS or not self.rows:
            return None
        poses = np.array([row[1:] for row in self.rows], dtype=np.float64)
        return Trajectory(np.array([row[0] for row in self.rows], dtype=np.int64), poses)

    def transformed(self, other_from_map: Pose2) -> Table:
        """Return a path in another fixed frame; other tables as they are."""
        path = self.path()
        return self if path is None else path_table(self.name, path.transformed(other_from_map))


def path_table(name: str, path: Trajectory) -> Table:
    """Return a path as a table."""
    rows = zip(path.stamps_ns.tolist(), *path.poses.T.tolist(), strict=True)
    return Table(name, PATH_COLUMNS, tuple(rows))


@dataclass(frozen=True, slots=True)
class SlamResult:
    """What a SLAM backend made of the readings.

    Parameters
    ----------
    trajectory : Trajectory
        `map_from_robot` at the stamp of every reading.
    covariances : (N, 3, 3) float64, optional
        Of every pose in the robot's frame [m, m, rad]; None where the backend does not know.
    pose_graph : PoseGraph or None
        Where the backend keeps one.
    tables : tuple of Table
        The backend's own diagnostics.
    notices : tuple of str
        What a user should know.
    moving_share : float, optional
        Share of the returns that were not matched, being on something that moves.
    """

    trajectory: Trajectory
    covariances: Floats | None = None
    pose_graph: PoseGraph | None = None
    tables: tuple[Table, ...] = ()
    notices: tuple[str, ...] = field(default=())
    moving_share: float | None = None

    def transformed(self, other_from_map: Pose2) -> SlamResult:
        """Return the same in another fixed frame; covariances are in the robot's and stay."""
        graph = self.pose_graph
        if graph is not None:
            graph = replace(graph, poses=compose(other_from_map.as_array(), graph.poses))
        return replace(
            self,
            trajectory=self.trajectory.transformed(other_from_map),
            pose_graph=graph,
            tables=tuple(table.transformed(other_from_map) for table in self.tables),
        )


def position_sds_m(slam: SlamResult) -> Floats | None:
    """Return the standard deviation of every position along an axis (N,) [m]; None if unknown."""
    if slam.covariances is None or not len(slam.covariances):
        return None
    variance = 0.5 * np.trace(slam.covariances[:, :2, :2], axis1=1, axis2=2)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


class SlamBackend(Protocol):
    """A SLAM method, fed one reading at a time; it says where the robot was and draws no map."""

    def update(self, reading: Reading) -> None:
        """Take one reading, later than all before."""
        ...

    def map_from_robot(self) -> Pose2:
        """Return the best present estimate of where the robot is."""
        ...

    def result(self) -> SlamResult:
        """Return the best trajectory for all readings so far; may be called any time.

        Raises
        ------
        RunFailed
            When no reading was usable.
        """
        ...

    def snapshot(self) -> State:
        """Return the whole state as data, that of random numbers included, for a checkpoint."""
        ...

    def restore(self, state: State) -> None:
        """Continue from a snapshot of a backend with the same configuration."""
        ...
