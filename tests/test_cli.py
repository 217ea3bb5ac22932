# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line: every file of the contract, one line and the right exit code per bad input."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from ros_bags import maker_of, write_recording

from slarm_graph.app.cli import main
from slarm_graph.config import RunConfig
from slarm_graph.files.configs import load_config
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.radio.files import read_radio_npz

CONTRACT = {
    *("run.json", "config.yaml", "trajectory.tum", "odometry.tum", "map.pgm", "map.yaml"),
    *("geographic_map.pgm", "geographic_map.yaml", "coverage.npz"),
    *("radio_map.npz", "radio_map.nc", "radio_map.csv", "radio_map.png"),
    *(
        "consistency.json",
        "conflicts.csv",
        "scans.csv",
        "metrics.json",
        "metrics.csv",
        "report.html",
        "log.txt",
    ),
}
BEAMS = 120


def room_ranges(x: float, y: float) -> np.ndarray:
    """Distances from a point to the walls of a room of 6 x 4 m, one per beam."""
    angles = -np.pi + np.arange(BEAMS) * 2 * np.pi / BEAMS
    with np.errstate(divide="ignore"):
        to_x = np.where(np.cos(angles) > 0, 3 - x, -3 - x) / np.cos(angles)
        to_y = np.where(np.sin(angles) > 0, 2 - y, -2 - y) / np.sin(angles)
    return np.minimum(to_x, to_y)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot drives 1.5 m through a room; its truth lies beside the bag."""
    return room_bag(tmp_path_factory.mktemp("bags") / "room.bag", 30)


def room_bag(path: Path, count: int, topics: tuple[str, ...] = ("/scan",)) -> Path:
    make = maker_of("bag")
    messages = []
    for i in range(count):
        stamp_s, x = 100.0 + 0.1 * i, 0.05 * min(i, 30)
        messages.append(("/odom", stamp_s, make.odom(stamp_s, x)))
        for topic in topics:
            scan = make.laser_scan(stamp_s, room_ranges(x, 0.0), angles=(-np.pi, 2 * np.pi / BEAMS))
            messages.append((topic, stamp_s, scan))
    still = make.transforms(100.0, ("base_link", "laser", (0.0, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0)))
    return write_recording(path, [("/tf_static", 100.0, still), *messages])


def run(*words: object) -> int:
    return main([str(word) for word in words])


def test_a_run_leaves_every_file_of_the_contract(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = tmp_path / "truth.tum"
    truth.write_text("".join(f"{100 + 0.1 * i:.1f} {0.05 * i} 0 0 0 0 0 1\n" for i in range(30)))
    code = run(
        *("run", bag, "--backend", "odometry", "--ap", "-1", "0", "2.5", "--ap", "1", "0", "2"),
        *("--out", tmp_path, "--name", "r", "--ground-truth", truth, "--set", "seed=7"),
    )
    assert code == 0
    out = capsys.readouterr().out
    assert "ate_rmse_m" in out
    assert out.splitlines()[-1].endswith("r/report.html")
    folder = tmp_path / "r"
    assert {entry.name for entry in folder.iterdir()} == CONTRACT | {"ground_truth.tum"}
    record = json.loads((folder / "run.json").read_text())
    assert (record["status"], record["seed"], record["scans"]) == ("ok", 7, 30)
    assert record["scans_per_s"] > 0
    assert len(record["input"]["sha256"]) == 64
    assert {"reading", "slam", "recovery", "radio map", "report"} <= record["stages"].keys()
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["ate_rmse_m"]["value"] < 1e-6
    assert metrics["ate_rmse_m"]["unit"] == "m"
    assert load_config(folder / "config.yaml") == RunConfig(backend="odometry", seed=7)
    assert yaml.safe_load((folder / "map.yaml").read_text())["image"] == "map.pgm"
    with (folder / "scans.csv").open() as file:
        assert [row["used"] for row in csv.DictReader(file)] == ["yes"] * 30
    assert len(read_trajectory(folder / "trajectory.tum")) == 30
    assert (tmp_path / "latest").resolve() == folder.resolve()


def test_the_report_is_one_self_contained_page(bag: Path, tmp_path: Path) -> None:
    assert run("run", bag, "-b", "odometry", "--ap", 0, 0, 2, "-o", tmp_path, "--name", "r") == 0
    page = (tmp_path / "r" / "report.html").read_text()
    assert len(page) < 6e6
    assert page.count("plotly.js v") <= 2
    for part in ("Trajectory over the map", "Radio map", "Metrics", "Time and memory by stage"):
        assert part in page
    assert "<link" not in page
    assert 'src="http' not in page


def test_same_seed_same_bytes(bag: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert run("run", bag, "--backend", "odometry", "--out", tmp_path, "--name", name) == 0
    same = [(tmp_path / name / "trajectory.tum").read_bytes() for name in ("a", "b")]
    assert same[0] == same[1]


def test_without_an_access_point_there_is_no_radio_map(bag: Path, tmp_path: Path) -> None:
    assert run("run", bag, "--backend", "odometry", "--out", tmp_path, "--name", "r") == 0
    assert not list((tmp_path / "r").glob("radio_map*"))


def test_an_access_point_outside_the_map_is_warned_about(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run("run", bag, "--backend", "odometry", "--ap", 20, 0, 2, "-o", tmp_path)
    assert code == 0
    assert "lies outside the map" in capsys.readouterr().err
    assert (tmp_path / "latest" / "radio_map.npz").is_file()


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """Run a command that must end with exit code 2 and one line; return the line."""
    assert run(*words) == 2
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    assert "Traceback" not in captured.err
    assert lines[0].startswith("slarm: ")
    return lines[0]


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "no such file"), (b"", "is empty"), (b"hello, not a bag", "not a")],
)
def test_files_that_are_no_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes | None, words: str
) -> None:
    path = tmp_path / "x.bag"
    if content is not None:
        path.write_bytes(content)
    line = refused(capsys, "run", path, "--out", tmp_path / "out")
    assert words in line
    assert str(path) in line


def test_a_recording_without_a_laser(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = room_bag(tmp_path / "blind.bag", 5, topics=())
    line = refused(capsys, "run", path, "--out", tmp_path / "out")
    assert "LaserScan" in line
    assert "/odom" in line


def test_two_lasers_without_a_choice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = room_bag(tmp_path / "two.bag", 5, topics=("/front", "/rear"))
    line = refused(capsys, "run", path, "--out", tmp_path / "out")
    assert "--scan /front" in line
    assert "--scan /rear" in line
    code = run("run", path, "--scan", "/rear", "-b", "odometry", "--out", tmp_path / "out")
    assert code == 0
    assert run("convert", path, tmp_path / "rear.log", "--scan", "/rear") == 0
    assert "--scan /front" not in capsys.readouterr().out


def test_a_typo_in_the_configuration(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("mapping:\n  max_rnge_m: 3\n")
    line = refused(capsys, "run", bag, "--config", path)
    assert line.endswith(
        f"{path}:2: unknown key 'mapping.max_rnge_m'; did you mean 'mapping.max_range_m'?"
    )
    line = refused(capsys, "run", bag, "--set", "mapping.resolution=0.1")
    assert "did you mean 'mapping.resolution_m'?" in line


def test_a_folder_that_cannot_be_written(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    line = refused(capsys, "run", bag, "--out", tmp_path / "file" / "out")
    assert "cannot write to" in line
    assert "--out" in line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run"], "no recording given"),
        (["run", "{bag}", "--ap", "1", "2"], "--ap needs three numbers X Y Z [m], got 1 2"),
        (["run", "{bag}", "--ap", "a", "b", "c"], "--ap needs three numbers X Y Z [m], got 'a'"),
        (["run", "{bag}", "--ap", "1e300", "0", "2"], "X Y Z must be finite, within 10000 km"),
        (["run", "{bag}", "--ap", "0", "0", "nan"], "--ap 0 0 nan: X Y Z must be finite"),
        (["run", "{bag}", "--ap", "0", "0", "-1"], "Z not below the floor"),
        (["run", "{bag}", "--ap", "a b c"], "--ap a b c: expected three numbers"),
        (["run", "{bag}", "--backend", "gmaping"], "no backend 'gmaping'; there are"),
        (["run", "{bag}", "--seed", "x"], "--seed"),
        (["run", "{bag}", "--seed", "-1"], "seed: Input should be greater than or equal to 0"),
        (["run", "{bag}", "--ground-truth", "nowhere.tum"], "no such file: nowhere.tum"),
        (["run", "--resume", "{tmp}"], "not a run folder"),
        (["fly"], "No such command 'fly'"),
        (["fly"], "; see slarm --help"),
        (["explore", "paper_room"], "(paper_room); see slarm explore --help"),
        (["eval", "traj"], "'traj'; see slarm eval --help"),
        (["eval", "trajectory", "a.tum", "b.tum"], "no such file: a.tum"),
        (["eval", "map", "a.yaml", "b.yaml"], "no such file: a.yaml"),
        (["eval", "relations", "a.relations", "b.tum"], "no such file: a.relations"),
        (["eval", "radio", "a.npz", "b.npz"], "no such file"),
        (["eval", "consistency", "a.tum", "{bag}"], "is a recording; the trajectory comes last"),
        (["radio", "a.yaml", "--ap", "0", "0", "2"], "no such file: a.yaml"),
        (["explore", "--world", "nowhere.yaml"], "nowhere.yaml"),
        (["explore", "--resolution", "0"], "explore.resolution_m: Input should be greater"),
        (["explore", "--explorer", "wanderer"], "no explorer 'wanderer'; there are"),
        (["compare", "{bag}", "--backends", "a,odometry"], "no backend 'a'"),
        (["compare", "{bag}", "--scheduler", "x"], "--scheduler x: no dask scheduler answers"),
        (["convert", "nowhere.bag", "{tmp}/x.mcap"], "no such file: nowhere.bag"),
    ],
)
def test_usage_errors(
    bag: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    line = refused(capsys, *(word.format(bag=bag, tmp=tmp_path) for word in words))
    assert message in line


def test_debug_shows_the_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("run", tmp_path / "x.bag", "--debug") == 2
    assert "Traceback" in capsys.readouterr().err


def test_relations_are_evaluated_at_the_recorded_laser(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    relations = tmp_path / "r.relations"
    relations.write_text("100.0 102.0 1.0 0 0 0 0 0\n")
    assert run("run", bag, "-b", "odometry", "--out", tmp_path, "--name", "r") == 0
    capsys.readouterr()
    assert run("eval", "relations", relations, tmp_path / "r", "--json") == 0
    metrics = json.loads(capsys.readouterr().out)
    assert metrics["relations_translation_m"]["value"] == pytest.approx(0, abs=1e-6)
    assert "at the laser" in metrics["relations_translation_m"]["note"]


def test_config_backends_and_doctor_speak(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("config", "--set", "seed=3") == 0
    assert yaml.safe_load(capsys.readouterr().out)["seed"] == 3
    assert run("backends") == 0
    assert {"odometry", "gmapping", "pose_graph"} <= set(capsys.readouterr().out.split())
    assert run("doctor") == 0


def test_interrupt_keeps_partial_results_and_resume_ends_the_same(tmp_path: Path) -> None:
    """A process of its own is stopped by SIGINT midway, then taken up again."""
    bag = room_bag(tmp_path / "long.bag", 60)
    assert run("run", bag, "-b", "odometry", "--out", tmp_path, "--name", "whole") == 0
    slow = (
        "import sys, time; from slarm_graph.backends.odometry import OdometryBackend as B\n"
        "take = B.update\n"
        "def update(self, reading):\n    take(self, reading)\n    time.sleep(0.1)\n"
        "B.update = update\n"
        "from slarm_graph.app.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", slow, "run", str(bag), "-b", "odometry", "--ap", "0", "0", "2"]
    options = ["--out", str(tmp_path), "--name", "part", "--set", "checkpoint.every_s=0.3"]
    process = subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True)
    state = tmp_path / "part" / "checkpoint" / "state.npz"
    deadline = time.monotonic() + 60
    while not state.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "interrupted after" in said
    record = json.loads((tmp_path / "part" / "run.json").read_text())
    assert record["status"] == "partial"
    assert 0 < record["scans"] < 60
    present = {entry.name for entry in (tmp_path / "part").iterdir()}
    assert present == CONTRACT | {"checkpoint"}

    assert run("run", "--resume", tmp_path / "part") == 0
    ends = [(tmp_path / name / "trajectory.tum").read_bytes() for name in ("part", "whole")]
    assert ends[0] == ends[1]
    assert json.loads((tmp_path / "part" / "run.json").read_text())["status"] == "ok"
    assert not (tmp_path / "part" / "checkpoint").exists()
    assert run("run", "--resume", tmp_path / "part") == 2


def test_resume_refuses_another_configuration(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("run", bag, "-b", "odometry", "--out", tmp_path, "--name", "r") == 0
    record = json.loads((tmp_path / "r" / "run.json").read_text())
    (tmp_path / "r" / "run.json").write_text(json.dumps(record | {"status": "partial"}))
    capsys.readouterr()
    line = refused(capsys, "run", "--resume", tmp_path / "r", "--set", "mapping.resolution_m=0.1")
    assert "mapping.resolution_m: 0.05 -> 0.1" in line


ROOM = """
name: closet
ceiling_m: 3
boundary_m: [[10, 20], [14, 20], [14, 23], [10, 23]]
start: {x_m: 11, y_m: 21, heading_deg: 90}
access_points: [{name: router, x_m: 12, y_m: 22.9, z_m: 2.5}]
"""


def test_a_world_is_driven_through_in_its_own_frame(tmp_path: Path) -> None:
    room = tmp_path / "room.yaml"
    room.write_text(ROOM)
    drive = ("--backend", "odometry", "--out", tmp_path, "--name")
    assert run("run", room, *drive, "r") == 0
    folder = tmp_path / "r"
    start = read_trajectory(folder / "trajectory.tum").poses[0]
    np.testing.assert_allclose(start, [11.0, 21.0, np.pi / 2], atol=1e-6)
    origin = yaml.safe_load((folder / "map.yaml").read_text())["origin"]
    np.testing.assert_allclose(origin, [10.0, 20.0, 0.0], atol=0.3)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["ate_rmse_unaligned_m"]["value"] < 0.1
    radio = read_radio_npz(folder / "radio_map.npz")
    assert [ap.name for ap in radio.access_points] == ["router"]
    assert run("run", room, *drive, "s", "--seed", 1) == 0
    paths = [(tmp_path / name / "odometry.tum").read_bytes() for name in "rs"]
    assert paths[0] != paths[1]
    assert run("check", room) == 0
