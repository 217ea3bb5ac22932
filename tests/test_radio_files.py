# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio maps written and read back, also by readers nobody here wrote."""

from __future__ import annotations

import csv
import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
import xarray

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.errors import BadInput
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.files import (
    read_radio_npz,
    write_radio_csv,
    write_radio_npz,
)
from slarm_graph.radio.netcdf import read_radio_netcdf, write_radio_netcdf
from slarm_graph.radio.pictures import write_radio_png


@pytest.fixture
def radio():
    rng = np.random.default_rng(0)
    loss_db = rng.uniform(50, 90, (2, 12, 17)).astype(np.float32)
    loss_db[:, rng.random((12, 17)) < 0.3] = np.nan
    return RadioMap(
        geometry=GridGeometry(-1.25, 2.5, 0.25, 12, 17),
        access_points=(
            AccessPoint("Süd, 50 %", 0.1, 2.7, 2.5),
            AccessPoint("n", 5.0, 3.0, 2.0, power_dbm=13.5, frequency_hz=2.4e9),
        ),
        path_loss_db=loss_db,
        line_of_sight=rng.random((2, 12, 17)) < 0.5,
        antenna_height_m=0.4,
        scenario="InF-DL",
        rician_factor_db=6.5,
        height_source="default",
    )


def assert_same(a, b):
    np.testing.assert_array_equal(a.path_loss_db, b.path_loss_db)
    np.testing.assert_array_equal(a.line_of_sight, b.line_of_sight)
    for name in ("geometry", "access_points", "antenna_height_m", "scenario", "height_source"):
        assert getattr(a, name) == getattr(b, name)
    assert a.rician_factor_db == b.rician_factor_db


def test_npz_round_trip(radio, tmp_path):
    write_radio_npz(tmp_path / "r.npz", radio)
    assert_same(read_radio_npz(tmp_path / "r.npz"), radio)


def test_netcdf_round_trip(radio, tmp_path):
    write_radio_netcdf(tmp_path / "r.nc", radio)
    assert_same(read_radio_netcdf(tmp_path / "r.nc"), radio)


@pytest.mark.parametrize("kind", ["npz", "nc"])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_links_of_unknown_sight_come_back(radio, tmp_path, kind, share):
    unknown = np.random.default_rng(1).random(radio.line_of_sight.shape) < share
    told = replace(radio, line_of_sight=radio.line_of_sight & ~unknown, los_unknown=unknown)
    write, read = {
        "npz": (write_radio_npz, read_radio_npz),
        "nc": (write_radio_netcdf, read_radio_netcdf),
    }[kind]
    write(tmp_path / "r", told)
    again = read(tmp_path / "r")
    np.testing.assert_array_equal(again.sight_unknown, unknown)
    np.testing.assert_array_equal(again.line_of_sight, told.line_of_sight)


def test_netcdf_opens_in_xarray_with_units(radio, tmp_path):
    write_radio_netcdf(tmp_path / "r.nc", radio)
    with xarray.open_dataset(tmp_path / "r.nc", engine="netcdf4") as data:
        assert data.attrs["Conventions"] == "CF-1.8"
        assert data["channel_power_gain_db"].attrs["units"] == "dB"
        assert data["x"].attrs["units"] == "m"
        np.testing.assert_allclose(data["x"], -1.125 + 0.25 * np.arange(17))
        np.testing.assert_allclose(data["y"], 2.625 + 0.25 * np.arange(12))
        assert [str(n) for n in data["access_point"].values] == ["Süd, 50 %", "n"]
        one = data["path_loss_db"].isel(access_point_index=1).sel(x=1.0, y=4.0, method="nearest")
        row, col = radio.geometry.cell_of([1.0, 4.0])
        np.testing.assert_array_equal(one, radio.path_loss_db[1, row, col])
        assert data["access_point_frequency_hz"].values.tolist() == [3.5e9, 2.4e9]


def test_csv_has_every_value_in_named_columns(radio, tmp_path):
    write_radio_csv(tmp_path / "r.csv", radio)
    lines = (tmp_path / "r.csv").read_text(encoding="utf-8").splitlines()
    assert any("frequency_hz=2400000000.0" in line for line in lines if line.startswith("#"))
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(rows) == np.isfinite(radio.path_loss_db).sum()
    for record in rows[::17]:
        index = [ap.name for ap in radio.access_points].index(record["access_point"])
        row, col = radio.geometry.cell_of([float(record["x_m"]), float(record["y_m"])])
        assert float(record["path_loss_db"]) == pytest.approx(
            radio.path_loss_db[index, row, col], abs=1e-3
        )
        assert bool(int(record["line_of_sight"])) == radio.line_of_sight[index, row, col]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04broken", b"CDF\x02", b"hello"])
@pytest.mark.parametrize("read", [read_radio_npz, read_radio_netcdf])
def test_other_files_are_refused_in_one_line(content, read, tmp_path):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(BadInput, match="not a radio map") as caught:
        read(tmp_path / "x")
    assert "\n" not in str(caught.value)


def test_files_are_the_same_every_time(radio, tmp_path):
    for write, name in ((write_radio_npz, "npz"), (write_radio_netcdf, "nc")):
        write(tmp_path / f"a.{name}", radio)
        write(tmp_path / f"b.{name}", radio)
        assert (tmp_path / f"a.{name}").read_bytes() == (tmp_path / f"b.{name}").read_bytes()


def test_picture_is_a_picture(radio, tmp_path):
    write_radio_png(tmp_path / "r.png", radio)
    image = cv2.imread(str(tmp_path / "r.png"))
    assert min(image.shape[:2]) > 400
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100


@pytest.fixture
def large():
    """A site of a million cells, all with a value."""
    shape = (1000, 1000)
    return RadioMap(
        geometry=GridGeometry(0.0, 0.0, 0.05, *shape),
        access_points=(AccessPoint("a", 1.0, 1.0, 2.5),),
        path_loss_db=np.linspace(50, 90, 10**6, dtype=np.float32).reshape(1, *shape),
        line_of_sight=np.ones((1, *shape), dtype=np.bool_),
        antenna_height_m=0.4,
        scenario="InF-DL",
        rician_factor_db=6.5,
        height_source="default",
    )


@pytest.mark.parametrize(
    ("write", "bytes_per_cell"), [(write_radio_csv, 25), (write_radio_png, 40)]
)
def test_writing_takes_little_memory(large, tmp_path, write, bytes_per_cell):
    """Text: a mask, the cells' numbers; a picture: some layers of 4 bytes, no colours as floats."""
    write(
        tmp_path / "first",
        replace(
            large,
            path_loss_db=large.path_loss_db[:, :9, :9],
            line_of_sight=large.line_of_sight[:, :9, :9],
            geometry=GridGeometry(0, 0, 0.05, 9, 9),
        ),
    )
    tracemalloc.start()
    try:
        write(tmp_path / "file", large)
        assert tracemalloc.get_traced_memory()[1] < bytes_per_cell * 10**6
    finally:
        tracemalloc.stop()
