# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A part of every kind comes in one file of another package, with settings, and is used."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from example_parts import PLUGINS, install, on_the_path
from test_cli import room_bag

from slarm_graph import (
    GridGeometry,
    OccupancyGrid,
    backends,
    match_scans,
    open_source,
    parts,
    read_radio_npz,
    read_trajectory,
    write_map,
)
from slarm_graph.app.cli import main
from slarm_graph.backend import silent
from slarm_graph.config import RunConfig


@pytest.fixture(scope="module", autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    site = tmp_path_factory.mktemp("site")
    install(site)
    with on_the_path(site):
        yield site


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot drives 1.5 m through a room."""
    return room_bag(tmp_path_factory.mktemp("bags") / "room.bag", 30)


@pytest.mark.parametrize("kind", parts.KINDS)
def test_every_kind_has_an_example_of_one_file(kind: str) -> None:
    (found,) = [
        project for project in PLUGINS.glob("*/pyproject.toml")
        if f'"{parts.KINDS[kind].group}"' in project.read_text()
    ]  # fmt: skip
    assert len(list(found.parent.glob("**/*.py"))) == 1


def test_examples_use_what_is_public() -> None:
    """Most of what they import comes from the package itself."""
    for path in PLUGINS.glob("*/*.py"):
        nodes = ast.walk(ast.parse(path.read_text()))
        assert any(isinstance(n, ast.ImportFrom) and n.module == "slarm_graph" for n in nodes)


def test_all_are_listed_as_usable(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["backends"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    for project in PLUGINS.glob("*/pyproject.toml"):
        text = project.read_text()
        name = text.partition('[project.entry-points."')[2].splitlines()[1].split()[0]
        assert " ready " in lines[name]


def test_a_backend_with_settings_and_a_metric(bag: Path, tmp_path: Path) -> None:
    chosen = ("--backend", "scaled_odometry", "--set", "scaled_odometry.scale=1.5")
    assert main(["run", str(bag), *chosen, "--out", str(tmp_path), "--name", "it"]) == 0
    out = tmp_path / "it"
    driven_m = read_trajectory(out / "odometry.tum").path_length_m()
    assert read_trajectory(out / "trajectory.tum").path_length_m() == pytest.approx(1.5 * driven_m)
    assert yaml.safe_load((out / "config.yaml").read_text())["scaled_odometry"] == {"scale": 1.5}
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["loop_gap_m"]["value"] == pytest.approx(1.5 * driven_m)
    assert "gap between start and end" in (out / "report.html").read_text()


def test_a_backend_goes_on_from_its_checkpoint(bag: Path) -> None:
    readings = list(open_source(bag))
    config, rng = RunConfig(backend="scaled_odometry"), np.random.default_rng(0)
    first, second = (backends.make(config.backend, config, rng, silent) for _ in range(2))
    for reading in readings[:10]:
        first.update(reading)
    second.restore(first.snapshot())
    for reading in readings[10:]:
        first.update(reading)
        second.update(reading)
    ends = [backend.result().trajectory.poses for backend in (first, second)]
    np.testing.assert_array_equal(*ends)


def test_settings_of_others_are_refused_like_ours(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "x.bag", "--set", "scaled_odometry.scal=1", "--set", "point_icp.x=1"]) == 2
    error = capsys.readouterr().err
    assert "did you mean 'scaled_odometry.scale'" in error
    assert "unknown key 'point_icp.x'" in error


def test_settings_of_others_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config"]) == 0
    text = capsys.readouterr().out
    assert "scaled_odometry:\n  # True travel over what the wheels report.\n  scale: 1.0" in text


def test_a_matcher(bag: Path) -> None:
    scans = [reading.scan for reading in open_source(bag)]
    config = RunConfig(point_icp={"max_distance_m": 0.3})
    match = match_scans(scans[4], scans[0], matcher="point_icp", config=config)
    assert match
    assert match.target_from_source.x == pytest.approx(0.2, abs=0.03)


def test_a_propagation_model(tmp_path: Path) -> None:
    occupied = np.zeros((30, 300), dtype=np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    hall = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 30, 300), occupied, ~occupied)
    write_map(tmp_path / "hall.yaml", hall)
    chosen = ("--set", "radio.propagation=two_slope", "--set", "two_slope.breakpoint_m=5")
    where = ("--ap", "1.05", "1.55", "0.5", "--out", str(tmp_path), "--name", "it")
    assert main(["radio", str(tmp_path / "hall.yaml"), *chosen, *where]) == 0
    radio = read_radio_npz(tmp_path / "it" / "radio_map.npz")
    at_1_m, at_5_m, at_25_m = (radio.path_loss_db[0, 15, 10 + 10 * d] for d in (1, 5, 25))
    assert at_5_m - at_1_m == pytest.approx(20.0 * np.log10(5.0), abs=0.01)
    assert at_25_m - at_5_m == pytest.approx(40.0 * np.log10(5.0), abs=0.01)


def test_a_recording_format(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "room.scans.csv"
    assert main(["convert", str(bag), str(path)]) == 0
    assert "30 scans of ROS 1 bag" in capsys.readouterr().out
    same = zip(open_source(bag), open_source(path), strict=True)
    for there, here in same:
        assert here.stamp_ns == there.stamp_ns
        np.testing.assert_array_equal(here.scan.ranges_m, there.scan.ranges_m)
    assert main(["check", str(path), "--set", "csv_scans.range_max_m=3.5"]) == 0
    assert "lie beyond 3.5 m" in capsys.readouterr().out
    chosen = ("--backend", "odometry", "--set", "csv_scans.range_max_m=3.5")
    assert main(["run", str(path), *chosen, "--out", str(tmp_path), "--name", "it"]) == 0
    config = yaml.safe_load((tmp_path / "it" / "config.yaml").read_text())
    assert config["csv_scans"] == {"range_max_m": 3.5}
    assert main(["convert", str(path), str(tmp_path / "back.bag")]) == 0
    assert len(list(open_source(tmp_path / "back.bag"))) == 30
    path.write_text(path.read_text() + "1, 2, what\n")
    assert main(["run", str(path), "--out", str(tmp_path)]) == 2
    assert f"{path}:32: expected numbers" in capsys.readouterr().err


def test_an_explorer(tmp_path: Path) -> None:
    chosen = ("--explorer", "nearest_open", "--set", "nearest_open.legs=3", "--resolution", "0.2")
    where = ("--backend", "odometry", "--out", str(tmp_path), "--name", "it")
    assert main(["explore", *chosen, *where]) == 0
    assert "it has had enough" in (tmp_path / "it" / "log.txt").read_text()


def test_a_command(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "straight.tum"
    path.write_text("0 0 0 0 0 0 0 1\n1 3 4 0 0 0 0 1\n")
    assert main(["length", str(path)]) == 0
    assert capsys.readouterr().out == "5.000\n"


@pytest.mark.slow
def test_pip_installs_them(tmp_path: Path) -> None:
    copies = shutil.copytree(PLUGINS, tmp_path / "plugins")
    projects = [str(path.parent) for path in sorted(copies.glob("*/pyproject.toml"))]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--target", str(tmp_path / "site"), *projects], check=True)
    code = "from slarm_graph.app.cli import main; main(['backends'])"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": f"{tmp_path / 'site'}:{Path(__file__).resolve().parents[1]}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "scaled_odometry" in done.stdout
