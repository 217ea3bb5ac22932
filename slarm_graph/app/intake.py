# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings into a backend, one by one: kept going, counted, stopped cleanly, saved on the way."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

import numpy as np
from numpy.typing import NDArray

from slarm_graph.app.progress import Progress
from slarm_graph.backend import SlamBackend
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Pose2
from slarm_graph.readings import LaserScan, Reading, Source
from slarm_graph.stamps import ns_to_seconds
from slarm_graph.trajectory import Trajectory

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class Intake:
    """What went into a backend so far.

    Parameters
    ----------
    stamps_ns : list of int
        Of every reading taken [ns].
    odometry : list of (float, float, float)
        `odom_from_robot` of every reading [m, m, rad]; nan where there was none.
    robot_from_laser : Pose2
        Of the latest scan [m, m, rad].
    problem : str
        Why it ended before the source did; empty when it did not.
    interrupted : bool
        Whether that was the user's wish.
    """

    stamps_ns: list[int] = field(default_factory=list)
    odometry: list[tuple[float, float, float]] = field(default_factory=list)
    robot_from_laser: Pose2 = field(default_factory=Pose2)
    problem: str = ""
    interrupted: bool = False

    def note(self, reading: Reading) -> None:
        """Count a reading that a backend has taken."""
        pose = reading.odom_from_robot
        self.stamps_ns.append(reading.stamp_ns)
        self.odometry.append((pose.x, pose.y, pose.theta) if pose else (np.nan,) * 3)
        self.robot_from_laser = reading.scan.robot_from_laser

    def stop(self, how: str, why: str = "", *, by_user: bool = False) -> None:
        """Note that it ended here, before the source did."""
        at = f" (t = {ns_to_seconds(self.stamps_ns[-1])} s)" if self.stamps_ns else ""
        self.problem = f"{how} after {len(self.stamps_ns)} scans{at}" + (f": {why}" if why else "")
        self.interrupted = by_user

    def odometry_trajectory(self) -> Trajectory | None:
        """Return `odom_from_robot` of the readings that had one."""
        poses = np.array(self.odometry).reshape(-1, 3)
        known = np.isfinite(poses).all(axis=1)
        if not known.any():
            return None
        return Trajectory(np.array(self.stamps_ns, dtype=np.int64)[known], poses[known])


def scans_at(source: Source, stamps_ns: NDArray[np.int64]) -> list[LaserScan]:
    """Read a source again for the scans at given stamps, as a result needs them."""
    wanted = set(stamps_ns.tolist())
    return [reading.scan for reading in source if reading.stamp_ns in wanted]


SaveState = Callable[[SlamBackend, Intake], None]


class Saver:
    """Saves the backend's state every now and then.

    Parameters
    ----------
    save : callable
        Told the backend and the intake.
    every_s : float
        Least wall time between two saves [s].
    """

    def __init__(self, save: SaveState, every_s: float) -> None:
        self._save, self._every_s = save, every_s
        self._saved_s = time.monotonic()

    def maybe(self, backend: SlamBackend, intake: Intake) -> None:
        """Save when it is due."""
        if time.monotonic() - self._saved_s >= self._every_s:
            self.now(backend, intake)

    def now(self, backend: SlamBackend, intake: Intake) -> None:
        """Save at once."""
        self._save(backend, intake)
        self._saved_s = time.monotonic()


def feed(
    source: Source, backend: SlamBackend, intake: Intake, saver: Saver, progress: Progress
) -> None:
    """Give a backend every reading it has not had yet.

    Ctrl-C ends it after the present reading, a second one at once. A failure after the first
    reading ends it too and is noted in the intake, so that what is known so far is kept.

    Parameters
    ----------
    source : Source
    backend : SlamBackend
    intake : Intake
        Grows with every reading; not empty when a run is resumed.
    saver : Saver
    progress : Progress

    Raises
    ------
    BadInput
        When the source cannot be read.
    """
    after_ns = intake.stamps_ns[-1] if intake.stamps_ns else None
    progress.start("slam", source.info().scan_count)
    with stop_on_signal() as stop:
        try:
            for reading in source:
                progress.advance()
                if after_ns is None or reading.stamp_ns > after_ns:
                    backend.update(reading)
                    intake.note(reading)
                    saver.maybe(backend, intake)
                if stop:
                    intake.stop("interrupted", by_user=True)
                    break
            saver.now(backend, intake)
        except BadInput:
            raise
        except Exception as error:
            if not intake.stamps_ns:
                raise
            intake.stop("failed", str(error))
            _log.error(intake.problem, exc_info=error)


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """Collect the first Ctrl-C or termination in a list; the next one acts at once.

    Stopping between readings, never within, keeps the backend's state whole.
    """
    received: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        """Note the first signal and say what will happen; act on the second."""
        if received:
            raise KeyboardInterrupt
        received.append(number)
        _log.warning("stopping after this scan, then writing what is known; again to stop at once")

    try:
        before = [(s, signal.signal(s, on_signal)) for s in (signal.SIGINT, signal.SIGTERM)]
    except ValueError:  # not in the main thread, where signals never arrive
        before = []
    try:
        yield received
    finally:
        for number, handler in before:
            signal.signal(number, handler)
