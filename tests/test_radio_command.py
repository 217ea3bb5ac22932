# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""`slarm radio` over a bare map: predicted, measured, and ways that keep the connection."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from slarm_graph.app.cli import main
from slarm_graph.files.maps import write_map
from slarm_graph.files.trajectories import tum_text
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.measured.files import read_measured_npz
from slarm_graph.trajectory import Trajectory

GRID = GridGeometry(0.0, 0.0, 0.1, 50, 80)


def bare_map(folder):
    free = np.ones(GRID.shape, dtype=bool)
    free[[0, -1]] = free[:, [0, -1]] = False
    free[:35, 40] = False
    write_map(folder / "map.yaml", OccupancyGrid(GRID, np.where(free, 0, 1).astype(np.float32)))
    return str(folder / "map.yaml")


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_predicted_with_ways(tmp_path, capsys):
    where = ["--out", str(tmp_path), "--name", "r"]
    ways = ["--threshold", "-35", "--from", "1,1", "--to", "7,1"]
    code = main(["radio", bare_map(tmp_path), "--ap", "2", "2", "2.5", *where, *ways])
    told = capsys.readouterr().out
    assert code == 0
    assert "shortest: " in told
    row = rows(tmp_path / "r" / "connectivity.csv")[0]
    assert 0.0 < float(row["share"]) < 1.0
    assert (tmp_path / "r" / "connectivity.yaml").is_file()
    assert {r["way"] for r in rows(tmp_path / "r" / "ways.csv")} >= {"shortest"}
    with np.load(tmp_path / "r" / "connectivity.npz") as made:
        assert np.nanmax(made["snr_db"]) > 40.0


def test_places_for_one_more(tmp_path, capsys):
    where = ["--out", str(tmp_path), "--name", "r", "--ap", "2", "2", "2.5"]
    words = ["radio", bare_map(tmp_path), *where, "--one-more", "2.4"]
    assert main([*words, "--threshold", "-35"]) == 0
    assert "one more at" in capsys.readouterr().out
    places = rows(tmp_path / "r" / "one_more.csv")
    gains = [float(place["gained_m2"]) for place in places]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 0.0
    assert main([*words, "--overwrite", "--threshold", "-150"]) == 0
    assert "connects no more floor" in capsys.readouterr().out
    assert main([*words, "--overwrite"]) == 2
    assert "--one-more says nothing without --threshold" in capsys.readouterr().err


def test_measured_along_a_trajectory(tmp_path, capsys):
    rng = np.random.default_rng(0)
    points = rng.uniform([0.3, 0.3], [7.7, 4.7], (400, 2))
    points = points[np.argsort(points[:, 1])]
    stamps = np.arange(400) * 10**9
    way = Trajectory(stamps, np.column_stack([points, np.zeros(400)]))
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "trajectory.tum").write_text(tum_text(way))
    away = np.hypot(*(points - [2.0, 2.0]).T)
    rss = -40.0 - 20.0 * np.log10(np.hypot(away, 2.0)) + rng.normal(size=400)
    lines = [f"{k},AP1,{value:.2f}" for k, value in enumerate(rss)] + ["7,percent,90"]
    (tmp_path / "wifi.csv").write_text("stamp,ap,rss_dbm\n" + "\n".join(lines))
    given = ["--rss", str(tmp_path / "wifi.csv"), "--trajectory", str(tmp_path / "drive")]
    where = ["--out", str(tmp_path), "--name", "m", "--set", "measured.node_side_m=0.5"]
    assert main(["radio", bare_map(tmp_path), *given, "--ap", "2", "2", "2.5", *where]) == 0
    told = capsys.readouterr().err
    assert "warning: 1 of 401 readings of signal strength outside -150 to 40 dBm, first" in told
    assert "percent was heard 1 time;" in told
    made = read_measured_npz(tmp_path / "m" / "measured_radio_map.npz")
    at = made.geometry.cell_of([6.05, 2.05])
    level = made.mean_dbm[0][tuple(at)]
    assert abs(level - (-40.0 - 20.0 * np.log10(np.hypot(4.05, 2.0)))) < 1.5
    assert main(["radio", bare_map(tmp_path), *given[:2], "--name", "x"]) == 2


def test_a_run_folder_stands_for_its_map(tmp_path, capsys):
    where = ["--out", str(tmp_path / "out"), "--ap", "2", "2", "2.5", "--name"]
    assert main(["radio", str(tmp_path), *where, "none"]) == 2
    assert "no map.yaml in it" in capsys.readouterr().err
    for source, name in ((bare_map(tmp_path), "a"), (str(tmp_path), "b")):
        assert main(["radio", source, *where, name]) == 0
    a, b = ((tmp_path / "out" / name / "radio_map.npz").read_bytes() for name in "ab")
    assert a == b


def test_half_a_way_is_refused(tmp_path):
    assert main(["radio", bare_map(tmp_path), "--ap", "2", "2", "2.5", "--from", "1,1"]) == 2


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--threshold", "nan"), "--threshold nan: a finite level"),
        (("--threshold", "-60", "--outage", "inf"), "--outage inf: a finite level"),
        (("--threshold", "-60", "--longest-outage", "-1"), "--longest-outage -1: seconds, 0 or"),
        (("--threshold", "-60", "--longest-outage", "5"), "nothing without --from and --to"),
        (("--from", "1,1", "--to", "2,2"), "--from and --to says nothing without --threshold"),
        (("--trajectory", "way.tum"), "--trajectory says nothing without --rss"),
    ],
)
def test_levels_and_times_that_cannot_be(tmp_path, capsys, words, why):
    given = ["radio", bare_map(tmp_path), "--out", str(tmp_path), "--ap", "2", "2", "2.5"]
    assert main([*given, *words]) == 2
    assert why in capsys.readouterr().err
