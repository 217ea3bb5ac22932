# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the NPZ, NetCDF and CSV files of predicted and of measured radio maps share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Scalar
from slarm_graph.tiles import Window

At = slice | Window | tuple[NDArray[np.int64], ...]
"""Some rows of a layer, a window of it, or cells by their rows and columns."""
Values = Mapping[str, NDArray[Any]]
"""Arrays of a file by name."""
AP_FIELDS = {
    "x_m": "m",
    "y_m": "m",
    "z_m": "m",
    "power_dbm": "dBm",
    "frequency_hz": "Hz",
}
SCALARS = ("antenna_height_m", "rician_factor_db", "expansion_radius_m")
LAYERS = ("los_probability", "los_unknown")
"""Only present where heights are uncertain, or cells were not seen."""
WORDS = ("scenario", "height_source")
GRID = ("origin_x_m", "origin_y_m", "resolution_m")
ROWS_AT_A_TIME = 5_000
"""Lines formatted together: half a megabyte of text at a time, instead of all of it."""


def column(access_points: Sequence[AccessPoint], name: str) -> Floats:
    """Field (A,) of all access points."""
    return np.array([getattr(ap, name) for ap in access_points], dtype=np.float64)


def columns_of_points(points: Sequence[AccessPoint]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield names and fields (A,) of all access points."""
    yield "access_point", np.array([ap.name for ap in points])
    yield from ((f"access_point_{name}", column(points, name)) for name in AP_FIELDS)


def csv_lines(ap: AccessPoint, formats: str, rows: Floats) -> str:
    """Lines of an access point's name, quoted as RFC 4180 asks, and numbers (N, C)."""
    quoted = ap.name.replace('"', '""').replace("%", "%%")
    return (f'"{quoted}",{formats}\n' * len(rows)) % tuple(rows.ravel().tolist())


def line_of_sight_classes(radio: RadioMap, index: int, at: At) -> NDArray[np.int8]:
    """Line of sight of some cells: 1 clear, 0 blocked, -1 unknown, through unobserved cells."""
    classes = radio.line_of_sight[index][at].astype(np.int8)
    if radio.los_unknown is not None:
        classes[radio.los_unknown[index][at]] = -1
    return np.asarray(classes)


def points_and_grid(
    values: Values, layers: NDArray[Any]
) -> tuple[tuple[AccessPoint, ...], GridGeometry]:
    """Make the access points and the geometry of layers (A, rows, cols) of a file's values."""
    fields = {name: np.asarray(values[f"access_point_{name}"], np.float64) for name in AP_FIELDS}
    points = tuple(
        AccessPoint(str(name), **{key: float(column[i]) for key, column in fields.items()})
        for i, name in enumerate(values["access_point"])
    )
    origin_x_m, origin_y_m, resolution_m = (float(np.asarray(values[n]).item()) for n in GRID)
    return points, GridGeometry(origin_x_m, origin_y_m, resolution_m, *layers.shape[1:])


def from_values(values: Values) -> RadioMap:
    """Make a radio map from a file's named values."""
    loss_db = np.asarray(values["path_loss_db"], dtype=np.float32)
    points, geometry = points_and_grid(values, loss_db)
    return RadioMap(
        geometry=geometry,
        access_points=points,
        path_loss_db=loss_db,
        line_of_sight=np.asarray(values["line_of_sight"]) > 0,
        antenna_height_m=float(np.asarray(values["antenna_height_m"]).item()),
        scenario=str(values["scenario"]),
        rician_factor_db=float(np.asarray(values["rician_factor_db"]).item()),
        height_source=str(values["height_source"]),
        los_probability=_optional(values, "los_probability", np.float32),
        los_unknown=_optional(values, "los_unknown", np.bool_),
        expansion_radius_m=float(np.asarray(values.get("expansion_radius_m", 0.0)).item()),
    )


def _optional(values: Values, name: str, kind: type[Scalar]) -> NDArray[Scalar] | None:
    return np.asarray(values[name], dtype=kind) if name in values else None
