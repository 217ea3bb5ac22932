# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The input of a run (`Job`, `ExploreJob`) and its results (`Run`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.backend import SlamResult
from slarm_graph.config import RunConfig
from slarm_graph.consistency import Contradictions
from slarm_graph.eval.metrics import Metric
from slarm_graph.geographic import GeographicMap
from slarm_graph.grid import OccupancyGrid
from slarm_graph.radio.measured.height_posterior import HeightPosterior
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.placement import placement_notices
from slarm_graph.radio.radio_map import radio_notices
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import SourceInfo
from slarm_graph.world import WorldMap


@dataclass(frozen=True, slots=True)
class Job:
    """A recording to process, and how.

    Parameters
    ----------
    paths : tuple of Path
        The recording; several ROS 1 bags are read as one.
    config : RunConfig
    access_points : tuple of AccessPoint
        In the map frame, whose origin is the robot's first pose, or that of a world. Without any
        there is no predicted radio map.
    ground_truth, relations : Path or None
        Files with the ground-truth trajectory and relative poses.
    rss : tuple of str
        Readings of signal strength: files, or topics with fields (`open_rss`); empty: those found
        with the recording (`signals_of`).
    truth_is_found : bool
        Whether these files were not given but found beside the recording.
    """

    paths: tuple[Path, ...]
    config: RunConfig
    access_points: tuple[AccessPoint, ...] = ()
    ground_truth: Path | None = None
    relations: Path | None = None
    rss: tuple[str, ...] = ()
    truth_is_found: bool = False


@dataclass(frozen=True, slots=True)
class ExploreJob:
    """A world for a simulated robot to explore."""

    world: WorldMap
    config: RunConfig


@dataclass(frozen=True, slots=True)
class Run:
    """The results of a job.

    Parameters
    ----------
    title : str
        Heading of the report.
    config : RunConfig
    info : SourceInfo
        Facts about the source, complete after it was read.
    log : ReadingLog
        All readings that the backend had, and why the run ended early if it did.
    slam : SlamResult
    grid : OccupancyGrid
        Rendered from the scans along the trajectory.
    geographic : GeographicMap
    radio : RadioMap or None
        None without an access point.
    consistency : Contradictions
        The run's verdict on itself.
    metrics : tuple of Metric
    measured : MeasuredMap or None
        None without readings of signal strength.
    heights : tuple of HeightPosterior
        What readings of signal strength said of heights that nobody had said.
    """

    title: str
    config: RunConfig
    info: SourceInfo
    log: ReadingLog
    slam: SlamResult
    grid: OccupancyGrid
    geographic: GeographicMap
    radio: RadioMap | None
    consistency: Contradictions
    metrics: tuple[Metric, ...]
    measured: MeasuredMap | None = None
    heights: tuple[HeightPosterior, ...] = ()

    def notices(self) -> tuple[str, ...]:
        """Return all warnings and notices for the user."""
        problem = (self.log.problem,) if self.log.problem else ()
        points = self.radio.access_points if self.radio else ()
        tiles = self.geographic.tiles
        radio = radio_notices(self.geographic.geometry, points, self.config.radio, tiles)
        placed = placement_notices(self.geographic, points, self.config.radio.mount_radius_m)
        heard = self.measured.notices if self.measured else ()
        verdict = self.consistency.notices()
        known = (*problem, *verdict, *self.info.notices, *self.slam.notices)
        return (*known, *radio, *placed, *heard)
