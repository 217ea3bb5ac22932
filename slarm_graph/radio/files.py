# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio maps as files: NPZ and NetCDF (CF-1.8) out and back in, CSV out; units inside."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.errors import BadInput
from slarm_graph.grid import GridGeometry

_AP_FIELDS = {
    "x_m": "m",
    "y_m": "m",
    "z_m": "m",
    "power_dbm": "dBm",
    "frequency_hz": "Hz",
}
_SCALARS = ("antenna_height_m", "rician_factor_db")
_WORDS = ("scenario", "height_source")
_ROWS_AT_A_TIME = 5_000
_GRID = ("origin_x_m", "origin_y_m", "resolution_m")


def write_radio_npz(path: Path, radio: RadioMap) -> None:
    """Write a radio map as a compressed NPZ of plain arrays, every name with its unit."""
    arrays: dict[str, NDArray[np.generic]] = {
        "path_loss_db": radio.path_loss_db,
        "channel_power_gain_db": radio.channel_power_gain_db,
        "line_of_sight": radio.line_of_sight,
        "access_point": np.array([ap.name for ap in radio.access_points]),
    }
    arrays |= {f"access_point_{name}": _column(radio, name) for name in _AP_FIELDS}
    arrays |= {name: np.asarray(getattr(radio.geometry, name)) for name in _GRID}
    arrays |= {name: np.asarray(getattr(radio, name)) for name in _SCALARS + _WORDS}
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_radio_npz(path: Path) -> RadioMap:
    """Read what `write_radio_npz` wrote.

    Raises
    ------
    BadInput
        When the file is not such an archive.
    """
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as archive:
            values = {name: archive[name] for name in archive.files}
        return _from_values(values)
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except (BadZipFile, ValueError, KeyError, EOFError, OSError) as error:
        raise BadInput(f"{path}: not a radio map written by slarm (a radio_map.npz)") from error


def write_radio_netcdf(path: Path, radio: RadioMap) -> None:
    """Write a radio map as classic NetCDF with CF-1.8 conventions; row 0 is the lowest y."""
    with netcdf_file(str(path), "w", version=2) as file:
        file.Conventions = "CF-1.8"
        file.title = "Radio map: expected path loss and channel power gain per access point"
        file.source = "slarm-graph"
        for name in _WORDS:
            setattr(file, name, getattr(radio, name))
        # A bare Python float would be stored in single precision.
        for name in _SCALARS:
            setattr(file, name, np.float64(getattr(radio, name)))
        for name in _GRID:
            setattr(file, name, np.float64(getattr(radio.geometry, name)))
        _put_coordinates(file, radio)
        _put_layers(file, radio)


def read_radio_netcdf(path: Path) -> RadioMap:
    """Read what `write_radio_netcdf` wrote.

    Raises
    ------
    BadInput
        When the file is not such a NetCDF file.
    """
    try:
        with path.open("rb") as raw, netcdf_file(raw, "r", mmap=False) as file:
            values = {name: np.array(v[:]) for name, v in file.variables.items()}
            for name in _GRID + _SCALARS + _WORDS:
                values[name] = np.asarray(_attribute(file, name))
        values["access_point"] = np.array(
            [b"".join(row).rstrip(b"\0 ").decode() for row in values["access_point"]]
        )
        return _from_values(values)
    except (TypeError, ValueError, KeyError, AttributeError, IndexError, OSError) as error:
        raise BadInput(f"{path}: not a radio map written by slarm ({error})") from error


def write_radio_csv(path: Path, radio: RadioMap) -> None:
    """Write one line per access point and cell with a value; lines with `#` hold the rest."""
    head = [f"# {name}: {getattr(radio, name)}" for name in _SCALARS + _WORDS]
    head.append(f"# resolution_m: {radio.geometry.resolution_m!r}")
    for ap in radio.access_points:
        fields = ", ".join(f"{name}={getattr(ap, name)!r}" for name in _AP_FIELDS)
        head.append(f"# access point {ap.name}: {fields}")
    head.append("access_point,x_m,y_m,path_loss_db,channel_power_gain_db,rss_dbm,line_of_sight")
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(head) + "\n")
        for index in range(len(radio.access_points)):
            file.writelines(_csv_lines(radio, index))


def _csv_lines(radio: RadioMap, index: int) -> Iterator[str]:
    """Lines of one access point, some thousand at a time."""
    loss_db = radio.path_loss_db[index]
    cells = np.argwhere(np.isfinite(loss_db))
    centers = radio.geometry.center_of(cells)
    values = loss_db[cells[:, 0], cells[:, 1]].astype(np.float64)
    clear = radio.line_of_sight[index][cells[:, 0], cells[:, 1]]
    power_dbm = radio.access_points[index].power_dbm
    # Names are quoted as RFC 4180 asks, so that a comma in one does not shift the columns.
    quoted = radio.access_points[index].name.replace('"', '""').replace("%", "%%")
    line = f'"{quoted}",%.4f,%.4f,%.4f,%.4f,%.4f,%d\n'
    rows = np.column_stack([centers, values, -values, power_dbm - values, clear])
    for first in range(0, len(rows), _ROWS_AT_A_TIME):
        part = rows[first : first + _ROWS_AT_A_TIME]
        yield (line * len(part)) % tuple(part.ravel().tolist())


def _column(radio: RadioMap, name: str) -> NDArray[np.float64]:
    return np.array([getattr(ap, name) for ap in radio.access_points], dtype=np.float64)


def _put_coordinates(file: netcdf_file, radio: RadioMap) -> None:
    geometry = radio.geometry
    x_m = geometry.origin_x_m + (np.arange(geometry.cols) + 0.5) * geometry.resolution_m
    y_m = geometry.origin_y_m + (np.arange(geometry.rows) + 0.5) * geometry.resolution_m
    for name, values in (("y", y_m), ("x", x_m)):
        file.createDimension(name, len(values))
        axis = file.createVariable(name, "f8", (name,))
        axis[:] = values
        axis.units = "m"
        axis.standard_name = f"projection_{name}_coordinate"
        axis.long_name = f"{name} of the cell centre in the map"
        axis.axis = name.upper()
    names = [ap.name.encode() for ap in radio.access_points]
    width = max(1, *(len(name) for name in names))
    file.createDimension("access_point_index", len(names))
    file.createDimension("name_length", width)
    label = file.createVariable("access_point", "S1", ("access_point_index", "name_length"))
    label[:] = np.array([list(n.ljust(width, b"\0")) for n in names], np.uint8).view("S1")
    label.long_name = "name of the access point"
    label._Encoding = "utf-8"
    for name, unit in _AP_FIELDS.items():
        field = file.createVariable(f"access_point_{name}", "f8", ("access_point_index",))
        field[:] = _column(radio, name)
        field.units = unit


def _put_layers(file: netcdf_file, radio: RadioMap) -> None:
    dimensions = ("access_point_index", "y", "x")
    where = " ".join(["access_point", *(f"access_point_{name}" for name in _AP_FIELDS)])
    for name, long_name, values, unit in (
        ("path_loss_db", "expected path loss", radio.path_loss_db, "dB"),
        ("channel_power_gain_db", "expected gain", radio.channel_power_gain_db, "dB"),
        ("rss_dbm", "received signal strength", radio.rss_dbm, "dBm"),
    ):
        layer = file.createVariable(name, "f4", dimensions)
        layer[:] = values
        layer.units = unit
        layer.long_name = long_name
        layer._FillValue = np.float32(np.nan)
        layer.coordinates = where
    sight = file.createVariable("line_of_sight", "i1", dimensions)
    sight[:] = radio.line_of_sight.astype(np.int8)
    sight.long_name = "line of sight"
    sight.units = "1"
    sight.flag_values = np.array([0, 1], dtype=np.int8)
    sight.flag_meanings = "blocked clear"
    sight.coordinates = where


def _attribute(file: netcdf_file, name: str) -> float | str:
    value = getattr(file, name)
    return value.decode() if isinstance(value, bytes) else float(value)


def _from_values(values: dict[str, NDArray[np.generic]]) -> RadioMap:
    loss_db = np.asarray(values["path_loss_db"], dtype=np.float32)
    fields = {name: np.asarray(values[f"access_point_{name}"], np.float64) for name in _AP_FIELDS}
    names = values["access_point"]
    points = tuple(
        AccessPoint(str(name), **{key: float(column[i]) for key, column in fields.items()})
        for i, name in enumerate(names)
    )
    origin_x_m, origin_y_m, resolution_m = (float(np.asarray(values[n]).item()) for n in _GRID)
    return RadioMap(
        geometry=GridGeometry(origin_x_m, origin_y_m, resolution_m, *loss_db.shape[1:]),
        access_points=points,
        path_loss_db=loss_db,
        line_of_sight=np.asarray(values["line_of_sight"]).astype(np.bool_),
        antenna_height_m=float(np.asarray(values["antenna_height_m"]).item()),
        scenario=str(values["scenario"]),
        rician_factor_db=float(np.asarray(values["rician_factor_db"]).item()),
        height_source=str(values["height_source"]),
    )
