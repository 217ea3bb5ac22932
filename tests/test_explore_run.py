# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Exploring with a run folder: a drive that fails on the way leaves what was known."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from test_cli import ROOM, run

from slarm_graph.app.explore import LiveFiles
from slarm_graph.backends.odometry import OdometryBackend
from slarm_graph.files.g2o import read_g2o
from slarm_graph.files.maps import read_map
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.readings import Reading

AFTER = 40


@pytest.fixture
def room(tmp_path: Path) -> Path:
    path = tmp_path / "room.yaml"
    path.write_text(ROOM)
    return path


def fail_at(count: int, error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the backend break at a reading."""
    take, taken = OdometryBackend.update, []

    def update(self: OdometryBackend, reading: Reading) -> None:
        taken.append(reading.stamp_ns)
        if len(taken) > count:
            raise error
        take(self, reading)

    monkeypatch.setattr(OdometryBackend, "update", update)


def explored(room: Path, *options: object) -> tuple[int, Path]:
    out = room.parent
    named = ("-o", out, "--name", "x", "--overwrite")
    code = run("explore", "--world", room, "-b", "odometry", *named, *options)
    return code, out / "x"


def test_a_failure_on_the_way_keeps_the_maps(
    room: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fail_at(AFTER, RuntimeError("broken"), monkeypatch)
    code, folder = explored(room)
    assert code == 1
    assert "failed after" in capsys.readouterr().err
    record = json.loads((folder / "run.json").read_text())
    assert record["status"] == "partial"
    assert "broken" in record["problem"]
    assert len(read_trajectory(folder / "trajectory.tum")) == AFTER
    assert (folder / "radio_map.npz").is_file()
    assert (folder / "report.html").is_file()


def test_a_drive_cut_short_at_once_leaves_its_live_map(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail_at(AFTER, KeyboardInterrupt(), monkeypatch)
    code, folder = explored(room)
    assert code == 130
    assert json.loads((folder / "run.json").read_text())["status"] == "partial"
    live = read_map(folder / "map.yaml")
    path = read_trajectory(folder / "trajectory.tum")
    assert len(path) == AFTER
    start = live.geometry.cell_of(path.poses[:1, :2])[0]
    np.testing.assert_array_equal(live.free[tuple(start)], True)


def test_live_files_change_nothing_of_the_drive(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times: list[int] = []
    write = LiveFiles.write

    def counted(self: LiveFiles) -> None:
        times.append(1)
        write(self)

    monkeypatch.setattr(LiveFiles, "write", counted)
    paths = []
    for every_s in (1000.0, 0.01):
        limits = ("--set", f"checkpoint.every_s={every_s}", "--set", "explore.mission_time_s=8")
        code, folder = explored(room, *limits)
        assert code == 0
        paths.append((folder / "trajectory.tum").read_bytes())
    assert paths[0] == paths[1]
    assert len(times) > 3


@pytest.mark.parametrize("backend", ["pose_graph", "gmapping"])
def test_every_path_of_a_drive_is_in_the_worlds_frame(room: Path, backend: str) -> None:
    named = ("-o", room.parent, "--name", backend, "--set", "explore.mission_time_s=8")
    assert run("explore", "--world", room, "-b", backend, *named) == 0
    folder = room.parent / backend
    path = read_trajectory(folder / "trajectory.tum")
    assert abs(path.poses[0]).sum() > 0.5, "the start is not the world's origin"
    if backend == "pose_graph":
        found = read_g2o(folder / "graph.g2o").graph.poses[:1]
    else:
        with (folder / "weighted_mean.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        found = [[float(rows[0][name]) for name in ("x_m", "y_m", "theta_rad")]]
    np.testing.assert_allclose(found, path.poses[:1], atol=1e-6)
