# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Feeding a backend: Ctrl-C, failures, and a run resumed equals a run in one go."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.app.checkpoint import Checkpoint, WriteInterval, saved_states
from slarm_graph.app.ending import Stop, memory_mb
from slarm_graph.app.feeding import feed
from slarm_graph.app.job import Job
from slarm_graph.app.pipeline import run
from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import RunFolder, create_run_folder
from slarm_graph.backends.odometry import OdometryBackend
from slarm_graph.config import CheckpointConfig, FrontendConfig, LimitsConfig, RunConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.files.states import SavedStates
from slarm_graph.files.trajectories import tum_text
from slarm_graph.geometry import Pose2
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import LaserScan, Reading, ScanStatus, SourceInfo


class Circle:
    """A source of readings along a circle; something may happen at one of them."""

    def __init__(self, count: int = 40, at: int = -1, event: str = "") -> None:
        self.count, self.at, self.event = count, at, event
        self.times_read = 0

    def info(self) -> SourceInfo:
        return SourceInfo("a circle", self.count)

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        return ()

    def __iter__(self) -> Iterator[Reading]:
        self.times_read += 1
        for i in range(self.count):
            if i == self.at:
                if self.event == "interrupt":
                    os.kill(os.getpid(), signal.SIGINT)
                elif self.event:
                    raise {"bad": BadInput, "broken": RuntimeError}[self.event](self.event)
            angle = 0.1 * i
            pose = Pose2(np.cos(angle), np.sin(angle), angle)
            scan = LaserScan(np.full(36, 2.0 + 0.01 * i), 0.0, np.pi / 18, 0.1, 5.0)
            yield Reading(1_000_000_000 + i * 100_000_000, scan, pose)


def backend() -> OdometryBackend:
    return OdometryBackend(Stage(), FrontendConfig(), np.random.default_rng(0))


def fed(
    source: Circle,
    to: OdometryBackend,
    folder: RunFolder,
    *,
    every_s: float = 1e9,
    keep: bool = False,
    had_before: int = 0,
    limits: LimitsConfig | None = None,
) -> ReadingLog:
    log = ReadingLog()
    rule = CheckpointConfig(every_s=every_s, keep=keep)
    checkpoint = Checkpoint(folder, rule, lambda: SavedStates({"backend": to.snapshot()}, {}))
    stop = Stop(limits or LimitsConfig())
    feed(source, to, log, checkpoint, Quiet(), stop, had_before=had_before)
    return log


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return create_run_folder(tmp_path, "run")


def test_interrupt_stops_between_readings_and_keeps_what_came_before(folder: RunFolder) -> None:
    taker = backend()
    log = fed(Circle(at=10, event="interrupt"), taker, folder)
    assert log.interrupted
    assert log.problem.startswith("interrupted after 11 scans (t = ")
    assert len(taker.result().trajectory) == 11
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_failure_midway_is_noted_and_what_came_before_is_kept(folder: RunFolder) -> None:
    taker = backend()
    log = fed(Circle(at=10, event="broken"), taker, folder)
    assert log.problem == "failed after 10 scans (t = 1.900000000 s): broken"
    assert not log.interrupted
    assert len(taker.result().trajectory) == 10


@pytest.mark.parametrize(("at", "event"), [(0, "broken"), (0, "bad"), (10, "bad")])
def test_bad_input_and_failures_before_the_first_reading_are_raised(
    at: int, event: str, folder: RunFolder
) -> None:
    with pytest.raises((BadInput, RuntimeError)):
        fed(Circle(at=at, event=event), backend(), folder)


def test_resumed_equals_in_one_go(folder: RunFolder) -> None:
    whole, first, second = backend(), backend(), backend()
    fed(Circle(), whole, folder)
    fed(Circle(at=17, event="interrupt"), first, folder)
    with saved_states(folder.path) as saved:
        assert saved is not None
        second.restore(saved.states["backend"])
    log = fed(Circle(), second, folder, had_before=18)
    assert tum_text(second.result().trajectory) == tum_text(whole.result().trajectory)
    odometry = log.odometry()
    assert odometry is not None
    assert len(odometry) == len(log.scans) == 40


@pytest.mark.parametrize("cost_s", [0.02, 0.5, 8.0])
def test_an_interval_that_is_not_given_loses_least(
    cost_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [0.0]
    monkeypatch.setattr("slarm_graph.app.checkpoint.time.monotonic", lambda: now_s[0])
    # Lost in an hour with one failure: writing, and half an interval of work on average.
    tried_s = np.arange(0.5, 1000.0, 0.5)
    best_s = tried_s[np.argmin(3600.0 * cost_s / tried_s + 0.5 * tried_s)]
    for every_s, due_s in ((None, best_s), (50.0, 50.0)):
        interval = WriteInterval(every_s)
        with interval.writing():
            now_s[0] += cost_s
        now_s[0] += due_s - 0.6
        assert not interval.is_due()
        now_s[0] += 1.2
        assert interval.is_due()


def test_a_write_that_fails_at_once_is_not_tried_again_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = [0.0]
    monkeypatch.setattr("slarm_graph.app.checkpoint.time.monotonic", lambda: now_s[0])
    interval = WriteInterval(None)
    for _ in range(2):
        with pytest.raises(OSError, match="full"), interval.writing():
            raise OSError("full")
        now_s[0] += 59.0
        assert not interval.is_due()
        now_s[0] += 2.0
        assert interval.is_due()


def test_checkpoints_are_written_when_due(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []
    monkeypatch.setattr(Checkpoint, "write", lambda _self: written.append(1))
    fed(Circle(5), backend(), folder, every_s=1e-9)
    assert len(written) == 6


@pytest.mark.parametrize(
    ("event", "keep", "count"), [("", False, 0), ("", True, 1), ("interrupt", False, 1)]
)
def test_the_last_checkpoint_is_written_to_go_on_from_or_to_keep(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch, event: str, keep: bool, count: int
) -> None:
    written: list[int] = []
    monkeypatch.setattr(Checkpoint, "write", lambda _self: written.append(1))
    fed(Circle(at=3, event=event), backend(), folder, keep=keep)
    assert len(written) == count


def test_a_checkpoint_that_cannot_be_written_is_told_and_the_run_goes_on(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_args: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("slarm_graph.app.checkpoint.write_states", full)
    with caplog.at_level("WARNING"):
        log = fed(Circle(), backend(), folder, keep=True)
    assert len(log) == 40
    assert not log.problem
    assert "could not be written (No space left on device); the run goes on" in caplog.text
    assert not list(folder.path.glob("checkpoint/*"))


@pytest.mark.parametrize(
    ("limits", "why"),
    [
        (LimitsConfig(max_time_s=1e-9), "stopped by --max-time 1e-09 after 1 scan"),
        (LimitsConfig(max_memory_mb=1.0), "stopped by --max-memory 1 after 1 scan"),
    ],
)
def test_limits_stop_reading(folder: RunFolder, limits: LimitsConfig, why: str) -> None:
    assert memory_mb() > 1.0
    log = fed(Circle(), backend(), folder, limits=limits)
    assert log.problem.startswith(why)
    assert not log.interrupted


def test_a_run_reads_its_recording_once(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Circle] = []

    def open_circle(*_paths: object, **_options: object) -> Circle:
        opened.append(Circle())
        return opened[-1]

    monkeypatch.setattr("slarm_graph.app.pipeline.open_source", open_circle)
    job = Job((Path("circle"),), RunConfig(backend="odometry"))
    done = run(job, folder, Quiet())
    assert [source.times_read for source in opened] == [1]
    assert len(done.log) == len(done.slam.trajectory) == 40
    assert done.grid.occupied.any()
