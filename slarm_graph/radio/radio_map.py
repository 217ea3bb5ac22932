# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The radio stage: from a geographic map, or a true world, to the expected gain in every cell."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.config import RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains
from slarm_graph.radio.line_of_sight import (
    line_of_sight_over_cells,
    line_of_sight_past_cells,
    line_of_sight_past_solids,
    line_of_sight_to_points,
)
from slarm_graph.radio.path_loss import find_scenario, outside_range, path_loss_db
from slarm_graph.radio.placement import placement_notices
from slarm_graph.raster.bands import bands
from slarm_graph.raster.fill import inside_solids
from slarm_graph.raster.patches import joined
from slarm_graph.truth_map import solid_heights_m
from slarm_graph.world import WorldMap

_log = logging.getLogger(__name__)

_MOUNT_STEP_M = 0.001
"""A millimetre: walls are known to about a centimetre."""


def radio_map(
    geographic: GeographicMap, access_points: Sequence[AccessPoint], config: RadioConfig
) -> RadioMap:
    """Compute the path loss from every access point to every reachable cell, eq. (15)-(16).

    Line of sight is decided on the map's solids where it has any, else on its cells.

    Parameters
    ----------
    geographic : GeographicMap
    access_points : sequence of AccessPoint, at least one
        A point outside the map is warned about and computed all the same.
    config : RadioConfig

    Raises
    ------
    BadInput
        Without an access point, for an unknown scenario or a frequency outside its range.
    """
    for notice in (
        *radio_notices(geographic.geometry, access_points, config),
        *placement_notices(geographic, access_points, config.mount_radius_m),
    ):
        _log.warning(notice)

    reachable = geographic.accessible | (geographic.states == CellState.EXPANSION)
    free = reachable | (geographic.states == CellState.ENCLOSED)

    positions = _positions_m(access_points)
    clear = np.stack([_recovered_line_of_sight(geographic, free, p, config) for p in positions])
    past = _past_unseen(geographic, positions, config)
    radio = _map_of(
        geographic.geometry,
        reachable,
        access_points,
        config,
        clear & ~past,
        geographic.height_source,
    )
    return replace(radio, los_unknown=clear & past & reachable) if past.any() else radio


def _positions_m(access_points: Sequence[AccessPoint]) -> list[Floats]:
    """Positions (3,) [m] of access points, of which there has to be one."""
    if not access_points:
        raise BadInput("a radio map needs at least one access point: --ap X Y Z")
    return [ap.position_m() for ap in access_points]


def unseen_pockets(states: NDArray[np.uint8]) -> Mask:
    """Cells (rows, cols) nobody has seen, in pockets that no obstacle parts from what is free.

    What walls enclose has the walls' height; behind an open border there may be anything.
    """
    free = np.isin(states, (CellState.ACCESSIBLE, CellState.EXPANSION, CellState.ENCLOSED))
    unknown = states == CellState.UNKNOWN
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    at_border = cv2.dilate(free.view(np.uint8), cross).view(np.bool_)
    at_border &= unknown
    return joined(unknown, at_border) if at_border.any() else at_border


def _past_unseen(
    geographic: GeographicMap, positions_m: Sequence[Floats], config: RadioConfig
) -> Mask:
    """Links (A, rows, cols) that pass unseen cells at whatever height: nobody knows if clear."""
    unseen = unseen_pockets(geographic.states)
    if not unseen.any():
        return np.zeros((len(positions_m), *unseen.shape), dtype=np.bool_)
    geometry, height_m, mount_m = (
        geographic.geometry,
        config.antenna_height_m,
        config.mount_radius_m,
    )
    return ~np.stack(
        [
            line_of_sight_past_cells(geometry, unseen, p, height_m, mount_radius_m=mount_m)
            for p in positions_m
        ]
    )


def _recovered_line_of_sight(
    geographic: GeographicMap, free: Mask, position_m: Floats, config: RadioConfig
) -> Mask:
    """Line of sight (rows, cols) on the map's solids where it has any, else on its cells."""
    geometry, height_m = geographic.geometry, config.antenna_height_m
    if not geographic.solids:
        return line_of_sight_over_cells(
            geometry,
            geographic.heights_m,
            position_m,
            height_m,
            mount_radius_m=config.mount_radius_m,
        )
    # The centre of a free cell on a wall's face may come to lie a little inside the wall.
    on_face = free & inside_solids(geometry, geographic.solids)
    position_m = _on_room_side(geographic, free & ~on_face, position_m, config.mount_radius_m)
    clear = line_of_sight_past_solids(geometry, geographic.solids, position_m, height_m)
    if on_face.any():
        points = geometry.center_of(np.argwhere(on_face))
        clear[on_face] = line_of_sight_to_points(points, geographic.solids, position_m, height_m)
    return clear


def _on_room_side(
    geographic: GeographicMap, free: Mask, position_m: Floats, radius_m: float
) -> Floats:
    """Move an access point that a recovered wall has swallowed to the wall's face in the room.

    Walls are recovered thinner than they are and a few centimetres off, so that a point mounted on
    one may lie nearer to its back, or behind it. The nearest free cell before it tells the side
    it serves.
    """
    geometry, plan = geographic.geometry, position_m[:2]
    reach_m = radius_m + geometry.resolution_m
    low = np.maximum(geometry.cell_of(plan - reach_m), 0)
    high = np.maximum(geometry.cell_of(plan + reach_m) + 1, 0)
    cells = geometry.center_of(np.argwhere(free[low[0] : high[0], low[1] : high[1]]) + low)
    away_m = np.linalg.norm(cells - plan, axis=1)
    if not len(cells) or away_m.min() > reach_m:
        return position_m
    way = cells[away_m.argmin()] - plan
    steps = math.ceil(float(away_m.min()) / _MOUNT_STEP_M)
    points = plan + np.linspace(0.0, 1.0, steps + 1)[:, None] * way
    hidden = np.zeros(len(points), dtype=np.bool_)
    for solid in geographic.solids:
        if solid.height_m > position_m[2]:
            hidden |= contains(solid.corners_m, points)
    if not hidden.any():
        return position_m
    face = points[min(int(np.flatnonzero(hidden)[-1]) + 1, steps)]
    return np.array([*face, position_m[2]])


def theoretical_radio_map(world: WorldMap, geometry: GridGeometry, config: RadioConfig) -> RadioMap:
    """Compute the radio map of the true geometry, for the world's own access points.

    A cell is free by the centre rule of `truth_map`.

    Raises
    ------
    BadInput
        As `radio_map`.
    """
    clear = [
        line_of_sight_past_solids(
            geometry,
            world.solids,
            position_m,
            config.antenna_height_m,
            boundary_m=world.boundary_m,
            mount_radius_m=config.mount_radius_m,
        )
        for position_m in _positions_m(world.access_points)
    ]
    free = solid_heights_m(world, geometry) <= 0.0
    return _map_of(geometry, free, world.access_points, config, np.stack(clear), "truth")


def radio_notices(
    geometry: GridGeometry, access_points: Sequence[AccessPoint], config: RadioConfig
) -> tuple[str, ...]:
    """Say what a user should know before trusting a radio map on this grid."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    notices = []
    for ap in access_points:
        if not (x_min <= ap.x_m <= x_max and y_min <= ap.y_m <= y_max):
            notices.append(
                f"access point {ap.name} at ({ap.x_m:g}, {ap.y_m:g}) m lies outside the map"
                f" ({x_min:.2f} to {x_max:.2f}, {y_min:.2f} to {y_max:.2f}) m; computed all the"
                " same"
            )
        low, high = find_scenario(config.scenario).distance_m
        if low <= abs(ap.z_m - config.antenna_height_m) and _farthest_m(geometry, ap) <= high:
            continue
        far = sum(
            np.count_nonzero(outside_range(distances_m, config.scenario))
            for distances_m in (
                _distances_m(geometry, ap, config, band.rows) for band in bands(geometry.shape)
            )
        )
        if far:
            notices.append(
                f"{far / (geometry.rows * geometry.cols):.1%} of the cells are outside the"
                f" {low:g} to {high:g} m for which {config.scenario} holds (access point {ap.name})"
            )
    return tuple(notices)


def _farthest_m(geometry: GridGeometry, ap: AccessPoint) -> float:
    """A distance that no antenna over the grid exceeds [m]."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    away_x, away_y = max(ap.x_m - x_min, x_max - ap.x_m), max(ap.y_m - y_min, y_max - ap.y_m)
    return math.hypot(away_x, away_y, ap.z_m)


def _map_of(
    geometry: GridGeometry,
    free: Mask,
    access_points: Sequence[AccessPoint],
    config: RadioConfig,
    clear: Mask,
    height_source: str,
) -> RadioMap:
    """Path loss and line of sight of every access point, nan where no antenna can be."""
    clear = clear & free
    loss_db: NDArray[np.float32] = np.full(clear.shape, np.nan, dtype=np.float32)
    for ap, ap_clear, ap_loss_db in zip(access_points, clear, loss_db, strict=True):
        for band in bands(free.shape):
            here, rows = free[band.rows], band.rows
            distances_m = _distances_m(geometry, ap, config, rows)[here]
            ap_loss_db[rows][here] = path_loss_db(
                distances_m, ap.frequency_hz, ap_clear[rows][here], config.scenario
            )
    return RadioMap(
        geometry=geometry,
        access_points=tuple(access_points),
        path_loss_db=loss_db,
        line_of_sight=clear,
        antenna_height_m=config.antenna_height_m,
        scenario=config.scenario,
        rician_factor_db=config.rician_factor_db,
        height_source=height_source,
    )


def _distances_m(
    geometry: GridGeometry, ap: AccessPoint, config: RadioConfig, rows: slice
) -> Floats:
    """3D distance from the access point to the antenna over every cell of some rows [m]."""
    x = geometry.origin_x_m + (np.arange(geometry.cols) + 0.5) * geometry.resolution_m
    y = geometry.origin_y_m + (np.arange(geometry.rows)[rows] + 0.5) * geometry.resolution_m
    flat_sq = (y[:, None] - ap.y_m) ** 2 + (x[None, :] - ap.x_m) ** 2
    return np.sqrt(flat_sq + (ap.z_m - config.antenna_height_m) ** 2)
