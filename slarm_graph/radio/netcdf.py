# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio maps as NetCDF-4 with CF-1.8 conventions, compressed; units inside."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

import netCDF4
import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import RadioMap
from slarm_graph.errors import BadInput
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.columns import (
    AP_FIELDS,
    GRID,
    SCALARS,
    WORDS,
    column,
    from_values,
    line_of_sight_classes,
)
from slarm_graph.raster.bands import looked_up
from slarm_graph.raster.layers import set_aside
from slarm_graph.tiles import columns_of

_CHUNK = (1, 256, 1024)
"""Cells that are compressed together, 1 MB of a layer: a viewer reads a part without the rest."""
_LEVEL: Final = 1
"""Of zlib. On the map of a large site level 6 takes three times as long for a file a third
smaller."""


def write_radio_netcdf(path: Path, radio: RadioMap) -> None:
    """Write a radio map; row 0 is the lowest y."""
    with netCDF4.Dataset(path, "w") as file:
        set_title(file, "Radio map: expected path loss and channel power gain per access point")
        for name in WORDS + SCALARS:
            file.setncattr(name, getattr(radio, name))
        for name in GRID:
            file.setncattr(name, getattr(radio.geometry, name))
        _put_coordinates(file, radio)
        _put_layers(file, radio)


def set_title(file: netCDF4.Dataset, title: str) -> None:
    """Give a file a title, and say which conventions it keeps."""
    file.Conventions, file.title, file.source = "CF-1.8", title, "slarm-graph"


def new_axes(file: netCDF4.Dataset, geometry: GridGeometry) -> Iterator[tuple[str, Any]]:
    """Yield names and variables of the coordinates of the cells' centres [m]."""
    origins_m = geometry.origin_y_m, geometry.origin_x_m
    for name, origin_m, count in zip("yx", origins_m, geometry.shape, strict=True):
        file.createDimension(name, count)
        axis = file.createVariable(name, "f8", (name,))
        axis[:] = origin_m + (np.arange(count) + 0.5) * geometry.resolution_m
        axis.units = "m"
        yield name, axis


def read_radio_netcdf(path: Path) -> RadioMap:
    """Read what `write_radio_netcdf` wrote.

    Raises
    ------
    BadInput
        When the file is not such a NetCDF file.
    """
    try:
        with netCDF4.Dataset(path) as file:
            file.set_auto_mask(False)
            values = {name: np.asarray(v[:]) for name, v in file.variables.items()}
            for name in GRID + SCALARS + WORDS:
                values[name] = np.asarray(file.getncattr(name))
        if (np.asarray(values["line_of_sight"]) < 0).any():
            values["los_unknown"] = np.asarray(values["line_of_sight"]) < 0
        if "los_probability" in values:  # blank where no antenna can be
            values["los_probability"] = np.nan_to_num(values["los_probability"])
        return from_values(values)
    except (TypeError, ValueError, KeyError, AttributeError, IndexError, OSError) as error:
        raise BadInput(f"{path}: not a radio map written by slarm ({error})") from error


def _put_coordinates(file: netCDF4.Dataset, radio: RadioMap) -> None:
    for name, axis in new_axes(file, radio.geometry):
        axis.standard_name = f"projection_{name}_coordinate"
        axis.long_name = f"{name} of the cell centre in the map"
        axis.axis = name.upper()
    names = [ap.name.encode() for ap in radio.access_points]
    width = max(1, *(len(name) for name in names))
    file.createDimension("access_point_index", len(names))
    file.createDimension("name_length", width)
    label = file.createVariable("access_point", "S1", ("access_point_index", "name_length"))
    label.long_name = "name of the access point"
    label._Encoding = "utf-8"
    label[:] = np.array([ap.name for ap in radio.access_points])
    for name, unit in AP_FIELDS.items():
        field = file.createVariable(f"access_point_{name}", "f8", ("access_point_index",))
        field[:] = column(radio.access_points, name)
        field.units = unit


def _put_layers(file: netCDF4.Dataset, radio: RadioMap) -> None:
    power_dbm = column(radio.access_points, "power_dbm").astype(np.float32)
    loss_db = _layer(file, "path_loss_db", "expected path loss", "dB")
    gain_db = _layer(file, "channel_power_gain_db", "expected gain", "dB")
    rss_dbm = _layer(file, "rss_dbm", "received signal strength", "dBm")
    sight = _layer(file, "line_of_sight", "line of sight", "1", "i1")
    sight.flag_values = np.array([-1, 0, 1], dtype=np.int8)
    sight.flag_meanings = "unknown blocked clear"
    likely = None
    if radio.los_probability is not None:
        likely = _layer(file, "los_probability", "probability of line of sight", "1")
    for index, power in enumerate(power_dbm):
        for rows in _chunk_rows(radio):
            sight[index, rows] = line_of_sight_classes(radio, index, rows)
            for cols in _chunk_columns(radio, rows):
                at = rows, cols
                values = looked_up(radio.path_loss_db[index], radio.where, at, math.nan)
                loss_db[index, rows, cols] = values
                gain_db[index, rows, cols] = -values
                rss_dbm[index, rows, cols] = power - values
                if likely is not None and radio.los_probability is not None:
                    likely[index, rows, cols] = radio.los_probability[index, rows, cols]
            set_aside(radio.path_loss_db, *_given(radio.los_probability))


def _given(layer: NDArray[np.float32] | None) -> tuple[NDArray[np.float32], ...]:
    return () if layer is None else (layer,)


def _chunk_rows(radio: RadioMap) -> Iterator[slice]:
    """Yield the rows of every row of chunks."""
    for first in range(0, radio.geometry.rows, _CHUNK[1]):
        yield slice(first, min(first + _CHUNK[1], radio.geometry.rows))


def _chunk_columns(radio: RadioMap, rows: slice) -> Iterator[slice]:
    """Yield columns of whole chunks; chunks without tiles are not written, and take no room."""
    cols, wide = radio.geometry.cols, _CHUNK[2]
    known = np.zeros(-(-cols // wide), dtype=np.bool_)
    for some in columns_of(radio.where, rows):
        known[some.start // wide : -(-some.stop // wide)] = True
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, past in edges.reshape(-1, 2).tolist():
        yield slice(first * wide, min(past * wide, cols))


def _layer(
    file: netCDF4.Dataset, name: str, long_name: str, units: str, kind: Literal["f4", "i1"] = "f4"
) -> Any:
    """Create a compressed variable with a value per access point and cell."""
    dimensions = ("access_point_index", "y", "x")
    size = tuple(
        min(most, len(file.dimensions[d])) for most, d in zip(_CHUNK, dimensions, strict=True)
    )
    layer = file.createVariable(
        name,
        kind,
        dimensions,
        compression="zlib",
        complevel=_LEVEL,
        shuffle=True,
        chunksizes=size,
        # A chunk is written whole and not looked at again.
        chunk_cache=math.prod(_CHUNK) * np.dtype(kind).itemsize,
        fill_value=math.nan if kind == "f4" else None,
    )
    layer.units = units
    layer.long_name = long_name
    layer.coordinates = " ".join(["access_point", *(f"access_point_{n}" for n in AP_FIELDS)])
    return layer
