# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A run that is stopped anywhere and taken up again ends with the bytes of one left alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slarm_graph import backends, parts
from slarm_graph.app.cli import main
from slarm_graph.app.ending import Stop
from slarm_graph.backend import SlamBackend, silent
from slarm_graph.config import ExploreConfig, RunConfig, SignalConfig, SimulationConfig
from slarm_graph.exploration.closed_loop import ClosedLoop
from slarm_graph.files.worlds import load_world, world_to_yaml
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.readings import Reading
from slarm_graph.world import WorldMap

BACKENDS = ("odometry", "gmapping", "pose_graph")


@pytest.fixture(scope="module")
def room() -> WorldMap:
    return load_world("paper_room")


@pytest.fixture(scope="module")
def readings(room: WorldMap) -> list[Reading]:
    """Once around and back to where it began, so that maps grow and loops close."""
    way = [[-3.0, -2.8], [2.0, -2.6], [2.6, 2.4], [-2.6, 2.6], [-3.0, -2.8], [2.0, -2.6]]
    script = waypoints(np.array(way), speed_m_s=0.8)
    return list(SourceFromWorld(room, RunConfig().simulation, seed=1, script=script))


def fresh(name: str, seed: int = 0) -> SlamBackend:
    return backends.make(name, RunConfig(), np.random.default_rng(seed), silent)


@pytest.mark.parametrize("name", BACKENDS)
def test_backends_go_on_from_any_reading(name: str, readings: list[Reading]) -> None:
    left_alone, taken = fresh(name), {}
    cuts = np.random.default_rng(3).choice(np.arange(1, len(readings)), 4, replace=False)
    for number, reading in enumerate(readings):
        if number in cuts:
            taken[number] = left_alone.snapshot()
        left_alone.update(reading)
    expected = left_alone.result()
    for number, state in taken.items():
        resumed = fresh(name, seed=99)
        resumed.restore(state)
        for reading in readings[number:]:
            resumed.update(reading)
        found = resumed.result()
        assert found.trajectory.poses.tobytes() == expected.trajectory.poses.tobytes()
        assert found.tables == expected.tables


@pytest.mark.parametrize("explorer", parts.registered("explorer"))
def test_drives_go_on_from_any_step(explorer: str, room: WorldMap) -> None:
    config = RunConfig(
        explore=ExploreConfig(explorer=explorer, resolution_m=0.2, mission_time_s=20.0),
        simulation=SimulationConfig(signals=SignalConfig(rate_hz=5.0)),
    )

    def loop(backend: str) -> ClosedLoop:
        return ClosedLoop(
            SimulatedWorld(room, config.simulation, np.random.default_rng(2)),
            fresh(backend),
            parts.make("explorer", config.explore.explorer, config, config.explore.driving),
            config.explore,
            extent_m=room.extent_m(),
            start=room.start,
        )

    left_alone, resumed, states = loop("odometry"), loop("odometry"), None
    while left_alone.step():
        if left_alone.survey.readings == 120:
            states = left_alone.snapshot()
    assert states is not None
    resumed.restore(states)
    assert resumed.survey.readings == 120
    while resumed.step():
        pass
    expected, found = left_alone.outcome(), resumed.outcome()
    assert found.truth.poses.tobytes() == expected.truth.poses.tobytes()
    assert found.trajectory.poses.tobytes() == expected.trajectory.poses.tobytes()
    for layer in ("observed", "visited", "footprint"):
        assert np.array_equal(getattr(found.coverage, layer), getattr(expected.coverage, layer))
    assert replace(found.report, planning_s=0.0) == replace(expected.report, planning_s=0.0)


def stopped_after(readings: int, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def reason(_self: Stop) -> str:
        asked.append(1)
        return "stopped by the test" if len(asked) == readings else ""

    monkeypatch.setattr(Stop, "reason", reason)


@pytest.mark.parametrize("backend", BACKENDS)
def test_explore_resumes(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: WorldMap
) -> None:
    (tmp_path / "room.yaml").write_text(world_to_yaml(room))
    options = ["--world", str(tmp_path / "room.yaml"), "-b", backend, "--out", str(tmp_path)]
    options += ["--set", "explore.mission_time_s=12", "--resolution", "0.2"]
    assert main(["explore", *options, "--name", "whole"]) == 0
    with monkeypatch.context() as early:
        stopped_after(70, early)
        assert main(["explore", *options, "--name", "part"]) == 1
    record = json.loads((tmp_path / "part" / "run.json").read_text())
    assert record["status"] == "partial"
    assert record["scans"] == 70
    assert main(["explore", "--resume", str(tmp_path / "part")]) == 0
    for name in ("trajectory.tum", "map.pgm", "radio_map.npz", "scans.csv"):
        part, whole = ((tmp_path / run / name).read_bytes() for run in ("part", "whole"))
        assert part == whole, name
    metrics = [
        json.loads((tmp_path / run / "metrics.json").read_text()) for run in ("part", "whole")
    ]
    for one in metrics:
        assert one.pop("planning_s", None) is not None
    assert metrics[0] == metrics[1]
    assert ("moving_share" in metrics[0]) == (backend != "odometry")


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.write_bytes(path.read_bytes()[:2000]),
        lambda path: path.write_bytes(b""),
        lambda path: np.savez(path, header=np.zeros(3)),
    ],
)
def test_a_harmed_checkpoint_is_told_in_one_line(
    harm: Callable[[Path], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = ["--out", str(tmp_path), "--name", "r", "--set", "explore.mission_time_s=12"]
    with monkeypatch.context() as early:
        stopped_after(20, early)
        assert main(["explore", "-b", "odometry", *options]) == 1
    harm(tmp_path / "r" / "checkpoint" / "state.npz")
    capsys.readouterr()
    assert main(["explore", "--resume", str(tmp_path / "r")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "state.npz: the checkpoint is damaged" in lines[0]
    assert "start the run anew" in lines[0]
