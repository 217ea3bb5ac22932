# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The radio map: expected path loss in every cell of a geographic map, or of a true world."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.config import RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, Scalar
from slarm_graph.radio.line_of_sight import line_of_sight_past_solids
from slarm_graph.radio.path_loss import find_scenario, outside_range, path_loss_db
from slarm_graph.radio.placement import placement_notices
from slarm_graph.radio.recovered_line_of_sight import recovered_line_of_sight
from slarm_graph.raster.bands import windows
from slarm_graph.raster.layers import blank_layer, new_layer
from slarm_graph.tiles import KnownTiles, Where, Window
from slarm_graph.truth_map import solid_heights_m
from slarm_graph.world import WorldMap

_log = logging.getLogger(__name__)


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
        *radio_notices(geographic.geometry, access_points, config, geographic.tiles),
        *placement_notices(geographic, access_points, config.mount_radius_m),
    ):
        _log.warning(notice)

    reachable, free = geographic.reachable, geographic.free
    sights = [
        recovered_line_of_sight(geographic, free, position_m, config)
        for position_m in _positions_m(access_points)
    ]
    del free
    for sight in sights:
        for part in windows(geographic.where, aside=[sight.probability]):
            at = part.cells
            sight.probability[at][sight.unknown[at] | ~reachable[at]] = 0.0
            sight.unknown[at] &= reachable[at]
    probability = _layers([sight.probability for sight in sights], geographic.where)
    unknown = _layers([sight.unknown for sight in sights], geographic.where)
    del sights
    radio = _map_of(
        geographic.geometry,
        reachable,
        access_points,
        config,
        probability,
        geographic.height_source,
        geographic.where,
    )
    unsure = any(
        bool(layer[part.cells].any()) for layer in unknown for part in windows(geographic.where)
    )
    return replace(
        radio,
        los_unknown=unknown if unsure else None,
        expansion_radius_m=geographic.expansion_radius_m,
        tiles=geographic.tiles,
    )


def _positions_m(access_points: Sequence[AccessPoint]) -> list[Floats]:
    """Positions (3,) [m] of at least one access point."""
    if not access_points:
        raise BadInput("a radio map needs at least one access point: --ap X Y Z")
    return [ap.position_m() for ap in access_points]


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
    return _map_of(
        geometry,
        free,
        world.access_points,
        config,
        np.stack([(mask & free).astype(np.float32) for mask in clear]),
        "truth",
        geometry.shape,
    )


def radio_notices(
    geometry: GridGeometry,
    access_points: Sequence[AccessPoint],
    config: RadioConfig,
    tiles: KnownTiles | None = None,
) -> tuple[str, ...]:
    """Warn of access points off the map and cells outside the scenario's range of distances."""
    where, size = tiles or geometry.shape, tiles.cells if tiles else geometry.rows * geometry.cols
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
                _distances_m(geometry, ap, config, part.cells) for part in windows(where)
            )
        )
        if far:
            notices.append(
                f"{far / size:.1%} of the cells are outside the"
                f" {low:g} to {high:g} m for which {config.scenario} holds (access point {ap.name})"
            )
    return tuple(notices)


def _farthest_m(geometry: GridGeometry, ap: AccessPoint) -> float:
    """Upper bound of the distance to any antenna over the grid [m]."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    away_x, away_y = max(ap.x_m - x_min, x_max - ap.x_m), max(ap.y_m - y_min, y_max - ap.y_m)
    return math.hypot(away_x, away_y, ap.z_m)


def _map_of(
    geometry: GridGeometry,
    free: Mask,
    access_points: Sequence[AccessPoint],
    config: RadioConfig,
    probability: NDArray[np.float32],
    height_source: str,
    where: Where,
) -> RadioMap:
    """Expected path loss, eq. (2), and line of sight; nan, or probability 0, where none can be."""
    loss_db = blank_layer(probability.shape, where)
    clear, unsure = np.zeros(probability.shape, dtype=np.bool_), False
    for n, (ap, likely, ap_loss_db) in enumerate(
        zip(access_points, probability, loss_db, strict=True)
    ):
        for part in windows(where, aside=[loss_db, probability]):
            here, at = free[part.cells], part.cells
            # What is read again is written whole, or pages around it come in from the blank file.
            ap_loss_db[at] = np.nan
            distances_m = _distances_m(geometry, ap, config, at)[here]
            ap_loss_db[at][here] = expected_path_loss_db(
                distances_m,
                ap.frequency_hz,
                likely[at][here].astype(np.float64),
                config.scenario,
            )
            clear[n][at] = likely[at] > 0.5
            unsure |= bool(((likely[at] > 0.0) & (likely[at] < 1.0)).any())
    return RadioMap(
        geometry=geometry,
        access_points=tuple(access_points),
        path_loss_db=loss_db,
        line_of_sight=clear,
        antenna_height_m=config.antenna_height_m,
        scenario=config.scenario,
        rician_factor_db=config.rician_factor_db,
        height_source=height_source,
        los_probability=probability if unsure else None,
    )


def _layers(layers: Sequence[NDArray[Scalar]], where: Where) -> NDArray[Scalar]:
    """Stack layers (rows, cols) of access points; one alone is not copied."""
    if len(layers) == 1:
        return layers[0][None]
    stack = new_layer((len(layers), *layers[0].shape), layers[0].dtype.type, where)
    for n, layer in enumerate(layers):
        for part in windows(where, aside=[stack, layer]):
            stack[n][part.cells] = layer[part.cells]
    return stack


def expected_path_loss_db(
    distance_m: Floats, frequency_hz: float, probability: Floats, scenario: str
) -> Floats:
    """Path loss of the expected power gain, eq. (2), over line of sight and its absence.

    E|H|^2 = p 10^(-L_LoS / 10) + (1 - p) 10^(-L_NLoS / 10).

    Parameters
    ----------
    distance_m : (N,)
        3D [m].
    frequency_hz : float
    probability : (N,)
        Of line of sight, 0 to 1.
    scenario : str

    Returns
    -------
    (N,) float64 [dB]
    """
    loss_db = path_loss_db(distance_m, frequency_hz, probability >= 1.0, scenario)
    unsure = (probability > 0.0) & (probability < 1.0)
    if unsure.any():
        off_m, p = distance_m[unsure], probability[unsure]
        clear, blocked = (
            10.0 ** (-0.1 * path_loss_db(off_m, frequency_hz, is_clear, scenario))
            for is_clear in (True, False)
        )
        loss_db[unsure] = -10.0 * np.log10(p * clear + (1.0 - p) * blocked)
    return loss_db


def _distances_m(
    geometry: GridGeometry, ap: AccessPoint, config: RadioConfig, window: Window
) -> Floats:
    """3D distance from the access point to the antenna over every cell of a window [m]."""
    rows, cols = (np.arange(at.start, at.stop) for at in window)
    x = geometry.origin_x_m + (cols + 0.5) * geometry.resolution_m
    y = geometry.origin_y_m + (rows + 0.5) * geometry.resolution_m
    flat_sq = (y[:, None] - ap.y_m) ** 2 + (x[None, :] - ap.x_m) ** 2
    return np.sqrt(flat_sq + (ap.z_m - config.antenna_height_m) ** 2)
