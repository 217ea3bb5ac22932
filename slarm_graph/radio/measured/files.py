# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Measured radio maps as files: NPZ out and back in, NetCDF (CF) and CSV out; units inside."""

from __future__ import annotations

import csv
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import BadInput
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.measured_map import FittedTerms, MeasuredMap

LAYERS = {
    "mean_dbm": ("expected received signal strength", "dBm"),
    "mean_sd_db": ("standard deviation of the expected level", "dB"),
    "reading_sd_db": ("standard deviation of a new reading about the expected level", "dB"),
}
"""Layers with their long name and unit."""

_AP_FIELDS = ("x_m", "y_m", "z_m", "power_dbm", "frequency_hz")
_GRID = ("origin_x_m", "origin_y_m", "resolution_m")
_ROWS_AT_A_TIME = 5_000
"""Lines formatted at once: bounds memory, and more is not faster."""


def write_measured_npz(path: Path, measured: MeasuredMap) -> None:
    """Write a measured map as a compressed NPZ of plain arrays, every name with its unit."""
    arrays = {name: getattr(measured, name) for name in LAYERS}
    arrays["access_point"] = np.array([ap.name for ap in measured.access_points])
    for name in _AP_FIELDS:
        column = [getattr(ap, name) for ap in measured.access_points]
        arrays[f"access_point_{name}"] = np.array(column)
    for field in fields(FittedTerms):
        arrays[f"fitted_{field.name}"] = np.array([getattr(f, field.name) for f in measured.fitted])
    arrays |= {name: np.asarray(getattr(measured.geometry, name)) for name in _GRID}
    arrays["antenna_height_m"] = np.asarray(measured.antenna_height_m)
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_measured_npz(path: Path) -> MeasuredMap:
    """Read what `write_measured_npz` wrote.

    Raises
    ------
    BadInput
        When the file is not such an archive.
    """
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as archive:
            values = {name: archive[name] for name in archive.files}
        mean = values["mean_dbm"]
        x_m, y_m, side_m = (float(values[name]) for name in _GRID)
        grid = GridGeometry(x_m, y_m, side_m, *mean.shape[1:])
        points = tuple(
            AccessPoint(str(name), *(float(values[f"access_point_{f}"][i]) for f in _AP_FIELDS))
            for i, name in enumerate(values["access_point"])
        )
        fitted = tuple(_fitted(values, i) for i in range(len(points)))
        layers = {name: np.asarray(values[name], dtype=np.float32) for name in LAYERS}
        height_m = float(values["antenna_height_m"])
        return MeasuredMap(grid, points, fitted=fitted, antenna_height_m=height_m, **layers)  # type: ignore[arg-type]
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except (BadZipFile, ValueError, KeyError, EOFError, OSError, TypeError) as error:
        raise BadInput(f"{path}: not a measured radio map written by slarm") from error


def _fitted(values: dict[str, NDArray[Any]], index: int) -> FittedTerms:
    found: dict[str, Any] = {}
    for field in fields(FittedTerms):
        value = values[f"fitted_{field.name}"][index]
        found[field.name] = tuple(value.tolist()) if value.ndim else value.item()
    return FittedTerms(**found)


def write_measured_netcdf(path: Path, measured: MeasuredMap) -> None:
    """Write a measured map as compressed NetCDF with CF conventions; row 0 is the lowest y."""
    grid = measured.geometry
    import netCDF4  # not for those who only want the tables

    with netCDF4.Dataset(path, "w") as file:
        file.Conventions = "CF-1.8"
        file.title = "Measured radio map: received signal strength per access point"
        file.source = "slarm-graph"
        file.antenna_height_m = measured.antenna_height_m
        for name, origin, count in (
            ("y", grid.origin_y_m, grid.rows),
            ("x", grid.origin_x_m, grid.cols),
        ):
            file.createDimension(name, count)
            axis = file.createVariable(name, "f8", (name,))
            axis[:] = origin + (np.arange(count) + 0.5) * grid.resolution_m
            axis.units, axis.axis = "m", name.upper()
            axis.standard_name = f"projection_{name}_coordinate"
        file.createDimension("access_point", len(measured.access_points))
        label = file.createVariable("access_point", str, ("access_point",))
        label[:] = np.array([ap.name for ap in measured.access_points], dtype=object)
        for name, (words, unit) in LAYERS.items():
            layer = file.createVariable(
                name, "f4", ("access_point", "y", "x"), zlib=True, fill_value=np.nan
            )
            layer[:] = getattr(measured, name)
            layer.long_name, layer.units = words, unit


def write_measured_csv(path: Path, measured: MeasuredMap) -> None:
    """Write one line per access point and cell with a value."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"access_point,x_m,y_m,{','.join(LAYERS)}\n")
        for index, ap in enumerate(measured.access_points):
            cells = np.argwhere(np.isfinite(measured.mean_dbm[index]))
            columns = [getattr(measured, name)[index][tuple(cells.T)] for name in LAYERS]
            rows = np.column_stack([measured.geometry.center_of(cells), *columns])
            quoted = ap.name.replace('"', '""').replace("%", "%%")
            line = f'"{quoted}",%.4f,%.4f,%.3f,%.3f,%.3f\n'
            for first in range(0, len(rows), _ROWS_AT_A_TIME):
                part = rows[first : first + _ROWS_AT_A_TIME]
                file.write((line * len(part)) % tuple(part.ravel().tolist()))


def write_access_points_csv(path: Path, measured: MeasuredMap) -> None:
    """Write what was fitted for every access point, one line each."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = fitted_rows(measured)
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def fitted_rows(measured: MeasuredMap) -> list[dict[str, float | int | str]]:
    """Return position and fitted terms of every access point, rounded for people."""
    rows: list[dict[str, float | int | str]] = []
    for ap, terms in zip(measured.access_points, measured.fitted, strict=True):
        facts: dict[str, float | int | str] = {"access_point": ap.name}
        facts |= {name: round(getattr(ap, name), 3) for name in ("x_m", "y_m", "z_m")}
        values = asdict(terms)
        position, spread = values.pop("position_sd_m"), values.pop("sd")
        facts |= dict(zip(("x_sd_m", "y_sd_m", "z_sd_m"), position, strict=True))
        facts |= {k: round(v, 3) if isinstance(v, float) else v for k, v in values.items()}
        names = ("level_at_1_m_sd_db", "exponent_sd", "wall_sd_db")
        facts |= {k: round(v, 3) for k, v in zip(names, spread, strict=True)}
        rows.append(facts)
    return rows
