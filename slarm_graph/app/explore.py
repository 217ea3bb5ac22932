# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The flow in a world: exploration -> maps -> radio map -> comparison with the truth -> report."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from slarm_graph import backends, parts
from slarm_graph.app.checkpoint import Checkpoint, WriteInterval, saved_states
from slarm_graph.app.ending import Stop
from slarm_graph.app.feeding import log_early_end
from slarm_graph.app.job import Run
from slarm_graph.app.map_images import of_layers, save_map
from slarm_graph.app.measuring import RadioInput
from slarm_graph.app.outputs import (
    save_geographic,
    save_readings,
    save_slam,
    save_trajectory,
)
from slarm_graph.app.pipeline import check_consistency, make_radio_maps
from slarm_graph.app.progress import Progress
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.app.run_report import save_report
from slarm_graph.app.world_accuracy import accuracy_metrics, sizes_metrics, variant_metrics
from slarm_graph.backend import SlamBackend
from slarm_graph.config import RunConfig
from slarm_graph.eval.assessment import assess
from slarm_graph.eval.metric_parts import References, Subject
from slarm_graph.eval.metric_table import in_table_order
from slarm_graph.eval.metrics import Metric
from slarm_graph.exploration.closed_loop import ClosedLoop, Exploration
from slarm_graph.files.states import SavedStates
from slarm_graph.frontends.simulation.simulator import make_world
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.mapping import render
from slarm_graph.radio.measured.rss_log import rss_with_scans
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import SourceInfo
from slarm_graph.recovery.fine_map import FineMap, fine_map
from slarm_graph.recovery.recover import recover_fine, with_sizes_of
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import World, WorldMap

_log = logging.getLogger(__name__)


def explore_world(world: WorldMap, config: RunConfig, folder: RunFolder, progress: Progress) -> Run:
    """Explore a world with a simulated robot; results are in the world's frame, by the known start.

    Raises
    ------
    BadInput, RunFailed
        When there are no results.
    """
    config = with_prior(world, config)
    for_world, for_backend = np.random.default_rng(config.seed).spawn(2)
    # world -> readings -> SLAM backend -> where to drive next, until everything is known
    with folder.stage("exploration", progress):
        simulated = make_world(world, config.simulation, for_world)
        backend = backends.make(config.backend, config, for_backend, progress.say)
        drive = _drive(simulated, backend, world, config, folder, progress)
        log = drive.log
        # Its submaps or particles take more memory than what comes of them.
        del backend, simulated
    # trajectory -> occupancy grid
    with folder.stage("map", progress):
        notices = (*drive.slam.notices, f"exploration ended: {drive.finished.reason}")
        slam = replace(drive.slam.transformed(drive.world_from_map), notices=notices)
        save_trajectory(folder, "trajectory", slam.trajectory)
        cells = {"resolution_m": config.explore.resolution_m}
        grid = render(log.scans, slam.trajectory, config.mapping.model_copy(update=cells))
        save_slam(folder, slam, grid)
    # trajectory -> consistency
    verdict = check_consistency(log, slam, folder, progress)
    # occupancy grid -> geographic map (GGMR)
    with folder.stage("recovery", progress):
        around = GridGeometry.covering(*world.extent_m(), config.explore.resolution_m)
        drawn = fine_map(log.scans, slam.trajectory, config.mapping, around.resolution_m, grid)
        geographic = recover_fine(drawn, slam.trajectory, config.recovery, around)
        save_geographic(folder, geographic)
    # readings of signal strength -> heights -> geographic map -> radio maps
    given = RadioInput(rss_with_scans(log), slam, world.access_points, config)
    geographic, radio, measured, heights = make_radio_maps(geographic, given, folder, progress)
    # truth -> accuracy and report
    with folder.stage("report", progress):
        truth = References(ground_truth=drive.truth)
        known = (truth, Pose2(), None, grid, geographic, radio, drive.report, verdict)
        subject = Subject(slam.trajectory, *known, slam.covariances, slam.moving_share)
        assert radio is not None, "a world that is explored has access points"
        own = accuracy_metrics(world, geographic, radio, config.radio, config.explore.area)
        others = _accuracy_otherwise(world, config, drawn, slam.trajectory)
        metrics = in_table_order((*own, *others, *assess(subject)))
        title = f"{world.name}, {config.backend}, {config.explore.explorer}"
        info = SourceInfo(f"simulated world {world.name}", len(log))
        run = Run(
            *(title, config, info, log, slam, grid, geographic, radio, verdict, metrics),
            measured=measured,
            heights=heights,
        )
        save_report(folder, run, truth)
    return run


def with_prior(world: WorldMap, config: RunConfig) -> RunConfig:
    """Set the prior knowledge of `explore.prior`: ceiling, laser height, perhaps obstacles' sizes.

    Sizes given in the configuration are kept.
    """
    recovery = config.recovery.model_copy(
        update={
            "ceiling_m": world.ceiling_m,
            "laser_height_m": config.simulation.lidar.height_m,
        }
    )
    if config.explore.prior == "extent+sizes":
        recovery = with_sizes_of(world, recovery)
    return config.model_copy(update={"recovery": recovery})


def _accuracy_otherwise(
    world: WorldMap, config: RunConfig, drawn: FineMap, trajectory: Trajectory
) -> tuple[Metric, ...]:
    """Compare maps recovered with other settings with the world."""
    drive = (world, drawn, trajectory, config)
    variants = variant_metrics(*drive) if config.explore.judge_variants else ()
    return (*sizes_metrics(*drive), *variants)


class LiveFiles:
    """Writes readings, trajectory and map during the drive, as SLAM estimates them at the time.

    Parameters
    ----------
    folder : RunFolder
    log : ReadingLog
    loop : ClosedLoop
        Only read: writing does not change the drive.
    interval : WriteInterval
    """

    def __init__(
        self, folder: RunFolder, log: ReadingLog, loop: ClosedLoop, interval: WriteInterval
    ) -> None:
        self._folder, self._log, self._loop = folder, log, loop
        self._interval = interval

    def write_if_due(self) -> None:
        """Write when it is due."""
        if self._interval.is_due():
            self.write()

    def write(self) -> None:
        """Write `odometry.tum`, `scans.csv`, `trajectory.tum` and `map.pgm/.yaml`."""
        with self._interval.writing():
            save_readings(self._folder, self._log)
            if len(self._log):
                save_trajectory(self._folder, "trajectory", self._loop.survey.believed)
            live = self._loop.live
            save_map(
                self._folder, "map", live.driving_geometry, of_layers(live.occupied, live.free)
            )


def _drive(
    simulated: World,
    backend: SlamBackend,
    world: WorldMap,
    config: RunConfig,
    folder: RunFolder,
    progress: Progress,
) -> Exploration:
    """Drive until the explorer has finished, the user or a limit stops it, or it fails."""
    log = ReadingLog()
    loop = ClosedLoop(
        simulated,
        backend,
        parts.make("explorer", config.explore.explorer, config, config.explore.driving),
        config.explore,
        extent_m=world.extent_m(),
        start=world.start,
        mapping=config.mapping,
        log=log,
    )

    with saved_states(folder.path) as saved:
        if saved is not None:
            loop.restore(saved.states)
    checkpoint = Checkpoint(folder, config.checkpoint, lambda: SavedStates(loop.snapshot(), {}))
    live = LiveFiles(folder, log, loop, WriteInterval(config.checkpoint.every_s))
    stop = Stop(config.limits)
    with stop.on_signals(), log_early_end(log):
        try:
            while loop.finished is None and loop.step():
                progress.advance()
                live.write_if_due()
                checkpoint.write_if_due()
                if reason := stop.reason():
                    log.stop(reason, by_user=stop.by_user)
                    break
            checkpoint.write_last(ended_early=bool(log.problem))
        finally:
            live.write()
    return loop.outcome()
