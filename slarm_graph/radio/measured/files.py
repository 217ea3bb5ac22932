# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Measured radio maps as files: NPZ out and back in, NetCDF (CF) and CSV out; units inside."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from slarm_graph.errors import BadInput
from slarm_graph.files.texts import csv_of
from slarm_graph.radio.columns import (
    GRID,
    ROWS_AT_A_TIME,
    Values,
    columns_of_points,
    csv_lines,
    points_and_grid,
)
from slarm_graph.radio.measured.measured_map import FittedTerms, MeasuredMap

LAYERS = {
    "mean_dbm": ("expected received signal strength", "dBm"),
    "mean_sd_db": ("standard deviation of the expected level", "dB"),
    "reading_sd_db": ("standard deviation of a new reading about the expected level", "dB"),
}
"""Layers with their long name and unit."""


def write_measured_npz(path: Path, measured: MeasuredMap) -> None:
    """Write a measured map as a compressed NPZ of plain arrays, every name with its unit."""
    arrays = {name: getattr(measured, name) for name in LAYERS}
    arrays |= columns_of_points(measured.access_points)
    for field in fields(FittedTerms):
        arrays[f"fitted_{field.name}"] = np.array([getattr(f, field.name) for f in measured.fitted])
    arrays |= {name: np.asarray(getattr(measured.geometry, name)) for name in GRID}
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
        points, grid = points_and_grid(values, values["mean_dbm"])
        fitted = tuple(_fitted(values, i) for i in range(len(points)))
        layers = {name: np.asarray(values[name], dtype=np.float32) for name in LAYERS}
        height_m = float(values["antenna_height_m"])
        return MeasuredMap(grid, points, fitted=fitted, antenna_height_m=height_m, **layers)  # type: ignore[arg-type]
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except (BadZipFile, ValueError, KeyError, EOFError, OSError, TypeError) as error:
        raise BadInput(f"{path}: not a measured radio map written by slarm") from error


def _fitted(values: Values, index: int) -> FittedTerms:
    found: dict[str, Any] = {}
    for field in fields(FittedTerms):
        value = values[f"fitted_{field.name}"][index]
        found[field.name] = tuple(value.tolist()) if value.ndim else value.item()
    return FittedTerms(**found)


def write_measured_netcdf(path: Path, measured: MeasuredMap) -> None:
    """Write a measured map as compressed NetCDF with CF conventions; row 0 is the lowest y."""
    import netCDF4  # not for those who only want the tables

    from slarm_graph.radio.netcdf import new_axes, set_title

    with netCDF4.Dataset(path, "w") as file:
        set_title(file, "Measured radio map: received signal strength per access point")
        file.antenna_height_m = measured.antenna_height_m
        for name, axis in new_axes(file, measured.geometry):
            axis.axis, axis.standard_name = name.upper(), f"projection_{name}_coordinate"
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
            for first in range(0, len(rows), ROWS_AT_A_TIME):
                part = rows[first : first + ROWS_AT_A_TIME]
                file.write(csv_lines(ap, "%.4f,%.4f,%.3f,%.3f,%.3f", part))


def write_access_points_csv(path: Path, measured: MeasuredMap) -> None:
    """Write what was fitted for every access point, one line each."""
    path.write_text(csv_of(fitted_rows(measured)), encoding="utf-8", newline="")


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
