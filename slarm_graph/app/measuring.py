# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured radio map of a run: readings of signal strength, heights, files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.backend import Heartbeat, SlamResult, position_sds_m, silent
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.signals.rss import beside, open_rss
from slarm_graph.geographic import GeographicMap
from slarm_graph.radio.measured.height_posterior import HeightPosterior, write_heights_csv
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.rss_log import RssAlongTrajectory, RssLog, merged, place

NO_SIGNALS = ("none",)
"""The value of `--rss` that ignores readings found with the recording."""


@dataclass(frozen=True, slots=True)
class Signals:
    """Readings of signal strength that come with a recording.

    Parameters
    ----------
    logs : tuple of RssLog
    notices : tuple of str
        Which readings of the recording are used, or could be.
    are_found : bool
        Whether they were found, not asked for: a run goes on without those that make no map.
    """

    logs: tuple[RssLog, ...] = ()
    notices: tuple[str, ...] = ()
    are_found: bool = False

    def along(self, slam: SlamResult, config: RunConfig) -> Signals:
        """Drop found logs with too few readings within the trajectory's time."""
        if not self.are_found:
            return self
        least = config.measured.least_readings
        kept, notices = [], []
        for log in self.logs:
            placed = _placed((log,), slam, config).readings.values()
            if max((int(one.heard.sum()) for one in placed), default=0) >= least:
                kept.append(log)
            else:
                few = f"of no access point {least} readings lie on the way"
                notices.append(f"no measured radio map of {log.description}: {few}")
        return replace(self, logs=tuple(kept), notices=(*self.notices, *notices))


@dataclass(frozen=True, slots=True)
class RadioInput:
    """What the radio maps of a run are made of, besides its geographic map.

    Parameters
    ----------
    logs : sequence of RssLog
    slam : SlamResult
    access_points : sequence of AccessPoint
    config : RunConfig
    """

    logs: Sequence[RssLog]
    slam: SlamResult
    access_points: Sequence[AccessPoint]
    config: RunConfig


def signals_of(
    given: Sequence[str], recording: Sequence[Path], distro: str | None = None
) -> Signals:
    """Open the readings that `--rss` names; else those beside the recording or certainly in it."""
    if tuple(given) == NO_SIGNALS:
        return Signals()
    named = given or [log for path in recording if (log := beside(path))]
    if named:
        return Signals(tuple(open_rss(one, recording, distro) for one in named))
    from slarm_graph.frontends.signals.rss_found import found_rss

    found = found_rss(recording, distro)
    logs = tuple(one.log for one in found if one.log is not None)
    return Signals(logs, tuple(one.notice() for one in found), are_found=True)


def measured_map(
    geographic: GeographicMap, given: RadioInput, heartbeat: Heartbeat = silent
) -> MeasuredMap:
    """Make the measured radio map from at least one log.

    The positions' standard deviation is that of the SLAM result, or `measured.position_sd_m`.

    Raises
    ------
    BadInput
        When no reading lies within the trajectory's time.
    """
    # Optimisers, NetCDF and matplotlib are loaded only where there is something for them to do.
    from slarm_graph.radio.measured.build_map import build_measured_map

    config, placed = given.config, _placed(given.logs, given.slam, given.config)
    total = sum(map(len, given.logs))
    if placed.outside == total:
        raise BadInput(
            "no reading of signal strength lies within the trajectory's time:"
            " do both have the same clock?"
        )
    made = build_measured_map(
        geographic, placed.readings, given.access_points, config.radio, config.measured, heartbeat
    )
    notices = [doubt for log in given.logs for doubt in log.doubts()]
    if placed.outside:
        notices.append(
            f"{placed.outside} of {total} readings of signal strength outside the way's time"
        )
    return replace(made, notices=(*notices, *made.notices))


def correct_heights(
    geographic: GeographicMap, given: RadioInput, heartbeat: Heartbeat
) -> tuple[GeographicMap, tuple[HeightPosterior, ...]]:
    """Infer uncertain heights from readings behind obstacles; return the map with them, and them.

    Nothing changes where no reading tells.
    """
    config = given.config
    if not (given.access_points and geographic.height_groups and config.measured.heights):
        return geographic, ()
    from slarm_graph.radio.measured.height_inference import infer_heights, with_heights

    found = _placed(given.logs, given.slam, config).readings
    rng = np.random.default_rng(config.seed)
    how = (config.radio, config.measured, rng, heartbeat)
    heights = infer_heights(geographic, found, given.access_points, *how)
    return with_heights(geographic, heights) if heights else geographic, heights


def save_heights(folder: RunFolder, heights: Sequence[HeightPosterior]) -> None:
    """Write the inferred heights of at least one obstacle."""
    with folder.replacing("obstacle_heights.csv") as temporary:
        write_heights_csv(temporary, heights)


def _placed(logs: Sequence[RssLog], slam: SlamResult, config: RunConfig) -> RssAlongTrajectory:
    """Readings along the trajectory, whose positions are as sure as it says."""
    sds_m = position_sds_m(slam)
    return place(
        merged(logs), slam.trajectory, config.measured.position_sd_m if sds_m is None else sds_m
    )


def save_measured(folder: RunFolder, measured: MeasuredMap) -> None:
    """Write the measured radio map in all its formats."""
    from slarm_graph.radio.measured.files import (
        write_access_points_csv,
        write_measured_csv,
        write_measured_netcdf,
        write_measured_npz,
    )
    from slarm_graph.radio.measured.pictures import write_measured_png

    for name, write in (
        ("measured_radio_map.npz", write_measured_npz),
        ("measured_radio_map.nc", write_measured_netcdf),
        ("measured_radio_map.csv", write_measured_csv),
        ("measured_radio_map.png", write_measured_png),
        ("measured_access_points.csv", write_access_points_csv),
    ):
        with folder.replacing(name) as temporary:
            write(temporary, measured)
