# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Logged RSS readings of all access points, and their poses along a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.readings import RssReadings
from slarm_graph.reading_log import ReadingLog
from slarm_graph.trajectory import Trajectory

_POSSIBLE_DBM = (-150.0, 40.0)
"""Levels that a radio can report: LoRa, the most sensitive, ends at -148 dBm (Semtech SX1276), and
40 dBm are 10 W. Most values in percent or dBuV lie outside; 20 dB less or more at either end makes
no difference to that."""


@dataclass(frozen=True, slots=True)
class RssLog:
    """Readings of signal strength, of any number of access points.

    Parameters
    ----------
    names : tuple of str
        Of the access points.
    stamps_ns : (N,) int64
        In time order [ns].
    access_point : (N,) int64
        Index into the names.
    rss_dbm : (N,) float64
        nan: listened for and not heard.
    description : str
        Where they come from.
    """

    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    access_point: NDArray[np.int64]
    rss_dbm: Floats
    description: str = ""

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @staticmethod
    def of_rows(
        stamps_ns: NDArray[np.int64], names: list[str], rss_dbm: Floats, description: str
    ) -> RssLog:
        """Make a log of rows in any order; every name is an access point, nan is not heard."""
        known, index = np.unique(np.array(names), return_inverse=True)
        order = np.argsort(stamps_ns, kind="stable")
        return RssLog(
            tuple(str(name) for name in known),
            stamps_ns[order],
            index[order].astype(np.int64),
            np.where(np.isfinite(rss_dbm), rss_dbm, np.nan)[order],
            description,
        )

    def doubts(self) -> tuple[str, ...]:
        """Warn of levels that are hardly dBm: out of a radio's range, or all the same."""
        low, high = _POSSIBLE_DBM
        beyond = np.flatnonzero((self.rss_dbm < low) | (self.rss_dbm > high))
        heard = self.rss_dbm[np.isfinite(self.rss_dbm)]
        if len(beyond):
            name = self.names[self.access_point[beyond[0]]]
            return (
                f"warning: {len(beyond)} of {count_of(len(self), 'reading')} of signal strength"
                f" outside {low:g} to {high:g} dBm, first {name} at {self.rss_dbm[beyond[0]]:g}:"
                " are they in dBm?",
            )
        if len(heard) > 1 and not np.ptp(heard):
            return (f"warning: every reading of signal strength is {heard[0]:g} dBm: no level?",)
        return ()


def rss_with_scans(log: ReadingLog) -> tuple[RssLog, ...]:
    """Return the signal strengths that came with the scans: one log, or none."""
    if not log.signals:
        return ()
    stamps_ns = np.array([stamp for stamp, _ in log.signals], dtype=np.int64)
    names = [signal.access_point for _, signal in log.signals]
    rss_dbm = np.array([signal.rss_dbm for _, signal in log.signals])
    return (RssLog.of_rows(stamps_ns, names, rss_dbm, "heard with the scans"),)


def merged(logs: Sequence[RssLog]) -> RssLog:
    """Return the readings of several logs as one; equal names are one access point."""
    names = [log.names[i] for log in logs for i in log.access_point.tolist()]
    stamps = np.concatenate([log.stamps_ns for log in logs])
    rss = np.concatenate([log.rss_dbm for log in logs])
    return RssLog.of_rows(stamps, names, rss, "; ".join(log.description for log in logs))


@dataclass(frozen=True, slots=True)
class RssAlongTrajectory:
    """A log with the poses of its readings along a trajectory.

    Parameters
    ----------
    readings : dict of str to RssReadings
        By the access point's name.
    outside : int
        Number of readings before the trajectory begins or after it ends, which are left out.
    """

    readings: dict[str, RssReadings]
    outside: int


def place(log: RssLog, trajectory: Trajectory, position_sd_m: float | Floats) -> RssAlongTrajectory:
    """Give every reading the robot's pose at its own stamp, by interpolation.

    Where whole decibels are mixed with other values, these are taken for single packets and the
    others for means of several, each a noise class of its own.

    Parameters
    ----------
    log : RssLog
    trajectory : Trajectory
    position_sd_m : float or (N,)
        Standard deviation of its positions along each axis, of all or of each pose [m].
    """
    first, last = trajectory.stamps_ns[0], trajectory.stamps_ns[-1]
    within = (log.stamps_ns >= first) & (log.stamps_ns <= last)
    poses = trajectory.at(log.stamps_ns[within])
    times_s = (log.stamps_ns[within] - first) * 1e-9
    sds_m = np.broadcast_to(position_sd_m, len(trajectory))
    sd_m = np.interp(times_s, (trajectory.stamps_ns - first) * 1e-9, sds_m)
    rss, owner = log.rss_dbm[within], log.access_point[within]
    whole = np.isnan(rss) | (rss == np.round(rss))
    classes = 2 if 0 < whole.sum() < len(whole) and (~whole).any() else 1
    noise_class = (whole if classes == 2 else np.zeros(len(whole))).astype(np.int64)
    readings = {}
    for index, name in enumerate(log.names):
        mine = owner == index
        readings[name] = RssReadings(
            poses[mine, :2],
            times_s[mine],
            rss[mine],
            noise_class[mine],
            poses[mine, 2],
            sd_m[mine],
            classes,
        )
    return RssAlongTrajectory(readings, int((~within).sum()))
