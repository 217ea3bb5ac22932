# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing of the result files of a run folder."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.app.allocation import return_freed
from slarm_graph.app.map_images import save_map
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.backend import SlamResult
from slarm_graph.config import RadioConfig
from slarm_graph.config.maps import LargeImage
from slarm_graph.consistency import Contradictions
from slarm_graph.eval.metrics import Metric, metrics_csv, metrics_json
from slarm_graph.files.consistency import CONFLICT_COLUMNS, conflict_rows, consistency_json
from slarm_graph.files.coverage import write_coverage
from slarm_graph.files.g2o import write_g2o
from slarm_graph.files.maps import masks_of
from slarm_graph.files.texts import csv_text
from slarm_graph.files.trajectories import tum_text
from slarm_graph.files.trajectory_covariances import (
    TrajectoryCovariance,
    write_trajectory_covariance,
)
from slarm_graph.geographic import CellState, GeographicMap, is_free
from slarm_graph.grid import Mask, OccupancyGrid
from slarm_graph.raster.bands import windows
from slarm_graph.reading_log import ReadingLog
from slarm_graph.stamps import ns_to_seconds
from slarm_graph.tiles import Window
from slarm_graph.trajectory import Trajectory

_log = logging.getLogger(__name__)


def save_trajectory(folder: RunFolder, name: str, trajectory: Trajectory | None) -> None:
    """Write `<name>.tum` where there is a trajectory."""
    if trajectory is not None:
        folder.write_text(f"{name}.tum", tum_text(trajectory))


def save_readings(folder: RunFolder, log: ReadingLog) -> None:
    """Write `odometry.tum`, and `scans.csv` with every recorded scan, used or why not."""
    save_trajectory(folder, "odometry", log.odometry())
    rows = (
        (ns_to_seconds(s.stamp_ns), "no" if s.reason else "yes", s.reason) for s in log.statuses()
    )
    folder.write_text("scans.csv", csv_text(("stamp_s", "used", "reason"), rows))
    folder.note(scans=len(log), robot_from_laser=log.robot_from_laser.as_array().tolist())


def save_slam(
    folder: RunFolder, slam: SlamResult, grid: OccupancyGrid, large: LargeImage = "whole"
) -> None:
    """Write covariances, occupancy map, pose graph and the backend's tables."""
    if slam.covariances is not None:
        known = TrajectoryCovariance(slam.trajectory.stamps_ns, slam.covariances)
        with folder.replacing("trajectory_covariance.npz") as temporary:
            write_trajectory_covariance(temporary, known)
    save_map(folder, "map", grid.geometry, masks_of(grid), large, grid.tiles)
    if slam.pose_graph is not None:
        with folder.replacing("graph.g2o") as temporary:
            write_g2o(temporary, slam.pose_graph)
    for table in slam.tables:
        folder.write_text(f"{table.name}.csv", csv_text(table.columns, table.rows))


def save_consistency(folder: RunFolder, result: Contradictions) -> None:
    """Write `consistency.json` with the verdict, and `conflicts.csv` with the contradictions."""
    folder.write_text("consistency.json", consistency_json(result))
    folder.write_text("conflicts.csv", csv_text(CONFLICT_COLUMNS, conflict_rows(result)))


def save_geographic(
    folder: RunFolder, geographic: GeographicMap, large: LargeImage = "whole"
) -> None:
    """Write the recovered map and its coverage.

    In the map every cell known to have no obstacle is free, accessible or not; `coverage.npz` has
    the states of the cells.
    """

    def masks(window: Window) -> tuple[Mask, Mask]:
        """Return the obstacle cells of a window and those known to have none."""
        states = geographic.states[window]
        return states == CellState.OBSTACLE, is_free(states)

    save_map(folder, "geographic_map", geographic.geometry, masks, large, geographic.tiles)
    with folder.replacing("coverage.npz") as temporary:
        write_coverage(temporary, geographic)


def save_metrics(folder: RunFolder, metrics: Sequence[Metric]) -> None:
    """Write `metrics.json` and `metrics.csv`."""
    folder.write_text("metrics.json", metrics_json(metrics))
    folder.write_text("metrics.csv", metrics_csv(metrics))


def save_radio(folder: RunFolder, radio: RadioMap | None, config: RadioConfig) -> None:
    """Write the radio map in all its formats, where there is one."""
    if radio is None:
        return
    # NetCDF and matplotlib are loaded only where there is something for them to do.
    from slarm_graph.radio.files import write_radio_csv, write_radio_npz
    from slarm_graph.radio.netcdf import write_radio_netcdf
    from slarm_graph.radio.pictures import write_radio_png

    forms: list[tuple[str, Callable[[Path, RadioMap], None]]] = [
        ("radio_map.npz", write_radio_npz),
        ("radio_map.nc", write_radio_netcdf),
        ("radio_map.png", write_radio_png),
    ]
    lines = sum(
        int(np.count_nonzero(np.isfinite(loss_db[part.cells])))
        for loss_db in radio.path_loss_db
        for part in windows(radio.where)
    )
    if lines <= config.csv_most_lines:
        forms.insert(2, ("radio_map.csv", write_radio_csv))
    elif config.csv_most_lines > 0:
        _log.warning(
            f"radio_map.csv would have {lines:,} lines and is left out; radio_map.nc has the same"
            f" values (--set radio.csv_most_lines={lines} writes it)"
        )
    for name, write in forms:
        return_freed()  # what one form, or its library, has loaded is not needed for the next
        with folder.replacing(name) as temporary:
            write(temporary, radio)
