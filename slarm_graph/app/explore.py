# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The flow in a world: drive until everything is known, then maps, radio map, truth, report."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from slarm_graph import backends
from slarm_graph.access_points import RadioMap
from slarm_graph.app.checkpoint import Checkpoint, resume_from
from slarm_graph.app.ending import Stop
from slarm_graph.app.feeding import early_end_logged
from slarm_graph.app.handed_over import with_prior
from slarm_graph.app.job import Run
from slarm_graph.app.live_files import LiveFiles
from slarm_graph.app.measuring import measured_map, save_measured
from slarm_graph.app.outputs import (
    save_geographic,
    save_radio,
    save_slam,
    save_trajectory,
)
from slarm_graph.app.pipeline import judged, with_heard
from slarm_graph.app.progress import Progress
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.app.run_report import save_report
from slarm_graph.app.truth import accuracy_metrics, sizes_metrics, variant_metrics
from slarm_graph.backend import SlamBackend
from slarm_graph.config import RunConfig
from slarm_graph.eval.assessment import assess
from slarm_graph.eval.metric_parts import References, Subject
from slarm_graph.eval.metric_table import in_table_order
from slarm_graph.eval.metrics import Metric
from slarm_graph.exploration import explorers
from slarm_graph.exploration.closed_loop import ClosedLoop, Exploration
from slarm_graph.files.states import SavedStates
from slarm_graph.frontends.simulation.worlds import make_world
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.mapping import render
from slarm_graph.radio.measured.log import heard_with
from slarm_graph.radio.propagation.over_map import predicted_radio_map
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import SourceInfo
from slarm_graph.recovery.recover import recover_scans
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import World, WorldMap

_log = logging.getLogger(__name__)


def explore_world(world: WorldMap, config: RunConfig, folder: RunFolder, progress: Progress) -> Run:
    """Let a robot find a world out; every file is in the world's frame, by the known start.

    Raises
    ------
    BadInput, RunFailed
        When there is nothing to show for it.
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
    # trajectory -> does it contradict itself
    verdict = judged(log, slam, folder, progress)
    # occupancy grid -> geographic map (GGMR)
    with folder.stage("recovery", progress):
        around = GridGeometry.covering(*world.extent_m(), config.explore.resolution_m)
        how = (config.mapping, config.recovery)
        geographic = recover_scans(log.scans, slam.trajectory, *how, geometry=around, grid=grid)
        save_geographic(folder, geographic)
    # readings of signal strength -> heights -> geographic map -> radio map
    known, heard = world.access_points, heard_with(log)
    geographic, heights = with_heard(geographic, heard, slam, known, config, folder, progress)
    with folder.stage("radio map", progress):
        radio = predicted_radio_map(geographic, world.access_points, config)
        save_radio(folder, radio, config.radio)
    # readings of signal strength -> measured radio map
    with folder.stage("measured radio map", progress):
        measured = measured_map(heard, slam, geographic, known, config, progress.say)
        save_measured(folder, measured)
    # truth -> accuracy and report
    with folder.stage("report", progress):
        truth = References(ground_truth=drive.truth)
        maps = (grid, geographic, radio)
        subject = Subject(slam.trajectory, truth, Pose2(), None, *maps, drive.report, verdict)
        accuracy = _accuracy(world, config, log, slam.trajectory, geographic, radio)
        metrics = in_table_order((*accuracy, *assess(subject)))
        title = f"{world.name}, {config.backend}, {config.explore.explorer}"
        info = SourceInfo(f"simulated world {world.name}", len(log))
        run = Run(
            *(title, config, info, log, slam, grid, geographic, radio, verdict, metrics),
            measured=measured,
            heights=heights,
        )
        save_report(folder, run, truth)
    return run


def _accuracy(
    world: WorldMap,
    config: RunConfig,
    log: ReadingLog,
    trajectory: Trajectory,
    geographic: GeographicMap,
    radio: RadioMap,
) -> tuple[Metric, ...]:
    """Compare the maps with the world, and those of other settings as far as that is wanted."""
    own = accuracy_metrics(world, geographic, radio, config.radio, config.explore.area)
    drive = (world, log.scans, trajectory, config)
    others = variant_metrics(*drive) if config.explore.judge_variants else ()
    return (*own, *sizes_metrics(*drive), *others)


def _drive(
    simulated: World,
    backend: SlamBackend,
    world: WorldMap,
    config: RunConfig,
    folder: RunFolder,
    progress: Progress,
) -> Exploration:
    """Close the loop until the explorer has finished, the user wishes to stop, or it fails."""
    log = ReadingLog()
    loop = ClosedLoop(
        simulated,
        backend,
        explorers.make(config),
        config.explore,
        extent_m=world.extent_m(),
        start=world.start,
        mapping=config.mapping,
        log=log,
    )

    def resume(saved: SavedStates) -> None:
        """Drive to where the checkpoint was written."""
        loop.restore(saved.states)

    resume_from(folder.path, resume)
    checkpoint = Checkpoint(
        folder, config.checkpoint.every_s, lambda: SavedStates(loop.snapshot(), {})
    )
    live = LiveFiles(folder, log, loop, config.checkpoint.every_s)
    stop = Stop(config.limits)
    with stop.on_signals(), early_end_logged(log):
        try:
            while loop.finished is None and loop.step():
                progress.advance()
                live.maybe()
                checkpoint.maybe()
                if why := stop.why():
                    log.stop(why, by_user=stop.by_user)
                    break
            checkpoint.write()
        finally:
            live.write()
    return loop.outcome()
