# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The radio map by any propagation model: the links to all cells, and their path loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph import parts
from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.config import RunConfig
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.radio.propagation.crossings import wall_crossings
from slarm_graph.radio.propagation.links import Links, PropagationModel
from slarm_graph.radio.radio_map import radio_map
from slarm_graph.raster.bands import by_windows, cells_of, windows
from slarm_graph.raster.layers import blank_layer

STANDARD = "3gpp"
"""The model that `radio_map` computes by itself."""


def make_model(config: RunConfig) -> PropagationModel:
    """Build the propagation model that a configuration names, with its own settings."""
    model: PropagationModel = parts.make(
        "propagation model", config.radio.propagation, config, config.radio
    )
    return model


def predicted_radio_map(
    geographic: GeographicMap, access_points: Sequence[AccessPoint], config: RunConfig
) -> RadioMap:
    """Compute the radio map by the propagation model that the configuration names.

    Raises
    ------
    BadInput
        As `radio_map`, and when there is no such model.
    """
    radio = radio_map(geographic, access_points, config.radio)
    if config.radio.propagation == STANDARD:
        return radio
    model = make_model(config)
    return by_model(radio, geographic.heights_m, model, config.radio.mount_radius_m)


def by_model(
    radio: RadioMap, heights_m: ArrayLike, model: PropagationModel, mount_radius_m: float
) -> RadioMap:
    """Replace the path loss of a radio map by that of another model on the same links.

    Parameters
    ----------
    radio : RadioMap
    heights_m : (rows, cols)
        Top of the obstacle in the cell [m].
    model : PropagationModel
    mount_radius_m : float
        Obstacles this near to an access point are its mount.
    """
    loss_db = blank_layer(radio.path_loss_db.shape, radio.where)
    for index, ap in enumerate(radio.access_points):
        for part in windows(radio.where):
            loss_db[index][part.cells] = np.nan
        known = _known(radio, index)
        points_m = radio.geometry.center_of(known)
        at = known[:, 0], known[:, 1]
        clear = radio.line_of_sight[index][at]
        links = links_to(
            radio.geometry,
            heights_m,
            ap,
            points_m,
            clear,
            antenna_height_m=radio.antenna_height_m,
            mount_radius_m=mount_radius_m,
        )
        loss_db[index][at] = model.path_loss_db(links).loss_db
    return replace(radio, path_loss_db=loss_db)


def _known(radio: RadioMap, index: int) -> NDArray[np.int64]:
    """Row and column (N, 2) of the cells with a value of an access point."""
    loss_db = radio.path_loss_db[index]
    return cells_of(by_windows(radio.where, 0, lambda w: np.isfinite(loss_db[w])), radio.where)


def links_to(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    ap: AccessPoint,
    points_m: Floats,
    clear: Mask | None = None,
    *,
    antenna_height_m: float,
    mount_radius_m: float,
) -> Links:
    """Return the links from an access point to antennas at points (N, 2) [m] of one height.

    Without `clear`, a link has line of sight when it crosses nothing.
    """
    position_m = ap.position_m()
    crossings = wall_crossings(
        geometry, heights_m, position_m, points_m, antenna_height_m, mount_radius_m=mount_radius_m
    )
    flat_m = np.linalg.norm(points_m - position_m[:2], axis=1)
    return Links(
        position_m,
        points_m,
        np.hypot(flat_m, ap.z_m - antenna_height_m),
        crossings == 0 if clear is None else clear,
        crossings,
        ap.frequency_hz,
        antenna_height_m,
    )
