# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The files of a run folder, each from the value it shows."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.backend import SlamResult, Table
from slarm_graph.files.coverage import write_coverage
from slarm_graph.files.g2o import write_g2o
from slarm_graph.files.maps import map_yaml, pgm_bytes, trinary_image
from slarm_graph.files.trajectories import tum_text
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.radio.files import write_radio_csv, write_radio_netcdf, write_radio_npz
from slarm_graph.radio.pictures import write_radio_png
from slarm_graph.reading_log import ReadingLog
from slarm_graph.stamps import ns_to_seconds
from slarm_graph.trajectory import Trajectory


def save_trajectory(folder: RunFolder, name: str, trajectory: Trajectory | None) -> None:
    """Write `<name>.tum` where there is a trajectory."""
    if trajectory is not None:
        folder.write_text(f"{name}.tum", tum_text(trajectory))


def save_readings(folder: RunFolder, log: ReadingLog) -> None:
    """Write `odometry.tum`, and `scans.csv` with every recorded scan and why it was not used."""
    save_trajectory(folder, "odometry", log.odometry())
    rows = (
        (ns_to_seconds(s.stamp_ns), "no" if s.reason else "yes", s.reason) for s in log.statuses()
    )
    folder.write_text("scans.csv", csv_text(("stamp_s", "used", "reason"), rows))
    folder.note(scans=len(log), robot_from_laser=log.robot_from_laser.as_array().tolist())


def save_slam(folder: RunFolder, slam: SlamResult, grid: OccupancyGrid) -> None:
    """Write occupancy map, pose graph and the backend's tables."""
    save_map(folder, "map", grid.geometry, grid.occupied, grid.free)
    if slam.pose_graph is not None:
        with folder.replacing("graph.g2o") as temporary:
            write_g2o(temporary, slam.pose_graph)
    for table in slam.tables:
        folder.write_text(f"{table.name}.csv", table_csv(table))


def save_map(
    folder: RunFolder, name: str, geometry: GridGeometry, occupied: Mask, free: Mask
) -> None:
    """Write `<name>.pgm` and `<name>.yaml`, map_server's trinary form."""
    folder.write_bytes(f"{name}.pgm", pgm_bytes(trinary_image(occupied, free)))
    folder.write_text(f"{name}.yaml", map_yaml(f"{name}.pgm", geometry))


def save_geographic(folder: RunFolder, geographic: GeographicMap) -> None:
    """Write the recovered map and its coverage.

    In the map every cell known to be without an obstacle is free, reachable or not; the states
    of the cells are in `coverage.npz`.
    """
    states = geographic.states
    free = np.isin(states, (CellState.ACCESSIBLE, CellState.EXPANSION, CellState.ENCLOSED))
    save_map(folder, "geographic_map", geographic.geometry, geographic.obstacle, free)
    with folder.replacing("coverage.npz") as temporary:
        write_coverage(temporary, geographic)


def save_radio(folder: RunFolder, radio: RadioMap | None) -> None:
    """Write the radio map in all its forms, where there is one."""
    if radio is None:
        return
    for name, write in (
        ("radio_map.npz", write_radio_npz),
        ("radio_map.nc", write_radio_netcdf),
        ("radio_map.csv", write_radio_csv),
        ("radio_map.png", write_radio_png),
    ):
        with folder.replacing(name) as temporary:
            write(temporary, radio)


def table_csv(table: Table) -> str:
    """Return a backend's table as CSV."""
    return csv_text(table.columns, table.rows)


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return columns and rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()
