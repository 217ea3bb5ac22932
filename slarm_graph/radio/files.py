# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio maps as files: NPZ out and back in, CSV out; units inside."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.access_points import RadioMap
from slarm_graph.errors import BadInput
from slarm_graph.files.arrays import read_arrays
from slarm_graph.files.npz import InParts, write_npz
from slarm_graph.grid import Mask
from slarm_graph.radio.columns import (
    AP_FIELDS,
    GRID,
    LAYERS,
    ROWS_AT_A_TIME,
    SCALARS,
    WORDS,
    columns_of_points,
    csv_lines,
    from_values,
    line_of_sight_classes,
)
from slarm_graph.raster.bands import bands, found_in_band, in_runs
from slarm_graph.raster.layers import set_aside
from slarm_graph.tiles import Where


def write_radio_npz(path: Path, radio: RadioMap) -> None:
    """Write a radio map as a compressed NPZ of plain arrays, every name with its unit."""
    write_npz(path, _arrays(radio))


def _arrays(radio: RadioMap) -> Iterator[tuple[str, ArrayLike | InParts]]:
    """Yield all arrays of the archive by name."""
    yield "path_loss_db", _in_parts(radio.path_loss_db, radio.where, math.nan)
    yield "channel_power_gain_db", _in_parts(radio.path_loss_db, radio.where, math.nan, minus=True)
    yield "line_of_sight", _in_parts(radio.line_of_sight, radio.where)
    yield from columns_of_points(radio.access_points)
    yield from ((name, getattr(radio.geometry, name)) for name in GRID)
    yield from ((name, getattr(radio, name)) for name in SCALARS + WORDS)
    for name in LAYERS:
        if (layer := getattr(radio, name)) is not None:
            yield name, _in_parts(layer, radio.where)


def _in_parts(
    layers: NDArray[np.float32] | Mask, where: Where, blank: float = 0.0, *, minus: bool = False
) -> InParts:
    """Layers (A, rows, cols), negated or not, in parts, blank outside of tiles."""

    def parts() -> Iterator[NDArray[np.generic] | int]:
        """Yield every value once."""
        for layer in layers:
            for run in in_runs(layer, where, blank):
                yield -run if minus and not isinstance(run, int) else run
            set_aside(layers)

    return InParts(layers.shape, layers.dtype, parts(), blank)


def read_radio_npz(path: Path) -> RadioMap:
    """Read what `write_radio_npz` wrote.

    Raises
    ------
    BadInput
        When the file is not such an archive.
    """
    values = read_arrays(path, "a radio map")
    try:
        return from_values(values)
    except (ValueError, KeyError, TypeError, OverflowError, IndexError) as error:
        raise BadInput(f"{path}: not a radio map written by slarm (a radio_map.npz)") from error


def write_radio_csv(path: Path, radio: RadioMap) -> None:
    """Write one line per access point and cell with a value; parameters in lines with `#`."""
    head = [f"# {name}: {getattr(radio, name)}" for name in SCALARS + WORDS]
    head.append(f"# resolution_m: {radio.geometry.resolution_m!r}")
    for ap in radio.access_points:
        fields = ", ".join(f"{name}={getattr(ap, name)!r}" for name in AP_FIELDS)
        head.append(f"# access point {ap.name}: {fields}")
    head.append("access_point,x_m,y_m,path_loss_db,channel_power_gain_db,rss_dbm,line_of_sight")
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(head) + "\n")
        for index in range(len(radio.access_points)):
            file.writelines(_csv_lines(radio, index))


def _csv_lines(radio: RadioMap, index: int) -> Iterator[str]:
    """Lines of one access point, some thousand at a time."""
    ap, loss_db = radio.access_points[index], radio.path_loss_db[index]
    for band in bands(radio.geometry.shape):
        valued = found_in_band(loss_db, radio.where, band, np.isfinite)
        for first in range(0, len(valued), ROWS_AT_A_TIME):
            at = np.unravel_index(valued[first : first + ROWS_AT_A_TIME], loss_db.shape)
            values = loss_db[at].astype(np.float64)
            classes = line_of_sight_classes(radio, index, at)
            centers = radio.geometry.center_of(np.stack(at, axis=1))
            rows = np.column_stack([centers, values, -values, ap.power_dbm - values, classes])
            yield csv_lines(ap, "%.4f,%.4f,%.4f,%.4f,%.4f,%d", rows)
