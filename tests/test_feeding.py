# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Feeding a backend: Ctrl-C, failures, and a run resumed equals a run in one go."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.app.checkpoint import load_checkpoint, save_checkpoint
from slarm_graph.app.feeding import Saver, feed
from slarm_graph.app.job import Job
from slarm_graph.app.pipeline import run
from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.backends.odometry import OdometryBackend
from slarm_graph.config import FrontendConfig, RunConfig, Stage
from slarm_graph.errors import BadInput
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


def fed(source: Circle, to: OdometryBackend, taken_until_ns: int | None = None) -> ReadingLog:
    return feed(source, to, Saver(lambda _b, _l: None, 1e9), Quiet(), taken_until_ns)


def test_interrupt_stops_between_readings_and_keeps_what_came_before() -> None:
    taker = backend()
    log = fed(Circle(at=10, event="interrupt"), taker)
    assert log.interrupted
    assert log.problem.startswith("interrupted after 11 scans (t = ")
    assert len(taker.result().trajectory) == 11
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_failure_midway_is_noted_and_what_came_before_is_kept() -> None:
    taker = backend()
    log = fed(Circle(at=10, event="broken"), taker)
    assert log.problem == "failed after 10 scans (t = 1.900000000 s): broken"
    assert not log.interrupted
    assert len(taker.result().trajectory) == 10


@pytest.mark.parametrize(("at", "event"), [(0, "broken"), (0, "bad"), (10, "bad")])
def test_bad_input_and_failures_before_the_first_reading_are_raised(at: int, event: str) -> None:
    with pytest.raises((BadInput, RuntimeError)):
        fed(Circle(at=at, event=event), backend())


def test_resumed_equals_in_one_go(tmp_path: Path) -> None:
    whole = backend()
    fed(Circle(), whole)

    folder, rng, first = create_run_folder(tmp_path, "run"), np.random.default_rng(5), backend()
    save = partial(save_checkpoint, folder, rng)
    feed(Circle(at=17, event="interrupt"), first, Saver(save, 1e9), Quiet())
    rng.random(3)

    second, other = backend(), np.random.default_rng(9)
    until_ns = load_checkpoint(folder.path, second, other)
    assert until_ns == 1_000_000_000 + 17 * 100_000_000
    assert other.random() == np.random.default_rng(5).random()
    log = fed(Circle(), second, until_ns)
    assert tum_text(second.result().trajectory) == tum_text(whole.result().trajectory)
    odometry = log.odometry()
    assert odometry is not None
    assert len(odometry) == 40


def test_a_damaged_checkpoint_is_named(tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path, "run")
    folder.write_text("checkpoint/state.npz", "not a checkpoint")
    with pytest.raises(BadInput, match="checkpoint cannot be read"):
        load_checkpoint(folder.path, backend(), np.random.default_rng(0))


def test_checkpoints_are_written_when_due() -> None:
    saved: list[int] = []
    saver = Saver(lambda _backend, log: saved.append(len(log)), 0.0)
    feed(Circle(5), backend(), saver, Quiet())
    assert saved == [1, 2, 3, 4, 5, 5]


def test_a_run_reads_its_recording_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Circle] = []

    def open_circle(*_paths: object, **_options: object) -> Circle:
        opened.append(Circle())
        return opened[-1]

    monkeypatch.setattr("slarm_graph.app.pipeline.open_source", open_circle)
    job = Job((Path("circle"),), RunConfig(backend="odometry"))
    done = run(job, create_run_folder(tmp_path, "run"), Quiet())
    assert [source.times_read for source in opened] == [1]
    assert len(done.log) == len(done.slam.trajectory) == 40
    assert done.grid.occupied.any()
