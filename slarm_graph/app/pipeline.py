# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The flow: recording -> readings -> SLAM -> geographic map -> radio map -> report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slarm_graph import backends
from slarm_graph.access_points import RadioMap
from slarm_graph.app.allocation import freeze_garbage_collector, keep_freed_layers
from slarm_graph.app.checkpoint import Checkpoint, saved_states
from slarm_graph.app.consistency_check import check_slam
from slarm_graph.app.ending import Stop
from slarm_graph.app.feeding import feed
from slarm_graph.app.job import Job, Run
from slarm_graph.app.measuring import (
    RadioInput,
    correct_heights,
    measured_map,
    save_heights,
    save_measured,
    signals_of,
)
from slarm_graph.app.outputs import (
    save_consistency,
    save_geographic,
    save_radio,
    save_readings,
    save_slam,
    save_trajectory,
)
from slarm_graph.app.progress import Progress
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.app.run_report import save_report
from slarm_graph.backend import SlamBackend, SlamResult
from slarm_graph.config import RunConfig
from slarm_graph.consistency import Contradictions
from slarm_graph.counts import count_of
from slarm_graph.eval.assessment import assess, drop_other_times, read_references
from slarm_graph.eval.metric_parts import Subject
from slarm_graph.files.states import SavedStates
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Pose2
from slarm_graph.mapping import end_points_m, render, thinned
from slarm_graph.radio.measured.height_posterior import HeightPosterior
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.rss_log import rss_with_scans
from slarm_graph.radio.propagation.over_map import predicted_radio_map
from slarm_graph.raster.layers import set_aside
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import Source
from slarm_graph.recovery.recover import recover
from slarm_graph.recovery.returns import gather_returns
from slarm_graph.trajectory import Trajectory

RadioMaps = tuple[GeographicMap, RadioMap | None, MeasuredMap | None, tuple[HeightPosterior, ...]]
"""The geographic map with corrected heights, the predicted and the measured radio map, and these
heights."""

_ENOUGH_POINTS = 1_000_000
"""Most returns kept for walls and figures: 16 MB, several per cell of kilometres of walls."""


def run(job: Job, folder: RunFolder, progress: Progress) -> Run:
    """Process a recording; every file is written as soon as its content is known.

    Parameters
    ----------
    job : Job
    folder : RunFolder
        A run with a checkpoint in it is continued.
    progress : Progress

    Raises
    ------
    BadInput, RunFailed
        When there are no results.
    """
    config, stop = job.config, Stop(job.config.limits)
    references = read_references(job.ground_truth, job.relations)
    # recording -> readings
    with folder.stage("reading", progress):
        signals = signals_of(job.rss, job.paths, config.source.ros_distro)
        source = _source(job)
    # readings -> SLAM backend
    backend, log = _run_backend(source, config, folder, progress, stop)
    info = source.info()
    del source
    # SLAM backend -> trajectory and occupancy grid
    with folder.stage("optimisation and map", progress):
        slam = _moved_to_start(backend.result(), info.truth)
        # Its submaps or particles take more memory than what comes of them.
        del backend
        save_trajectory(folder, "trajectory", slam.trajectory)
        progress.say(f"rendering {count_of(len(log), 'scan')}")
        grid = render(log.scans, slam.trajectory, config.mapping)
        save_slam(folder, slam, grid, config.mapping.large_image)
    # trajectory -> consistency
    verdict = check_consistency(log, slam, folder, progress)
    # occupancy grid -> geographic map (GGMR)
    with folder.stage("recovery", progress), keep_freed_layers():
        ends = thinned(end_points_m(log.scans, slam.trajectory, config.mapping), _ENOUGH_POINTS)
        returns = gather_returns(ends, grid.geometry.resolution_m)
        geographic = recover(grid, slam.trajectory, config.recovery, returns=returns)
        save_geographic(folder, geographic, config.mapping.large_image)
    # geographic map and readings of signal strength -> radio maps
    signals = signals.along(slam, config)
    info = replace(info, notices=(*info.notices, *signals.notices))
    given = RadioInput((*signals.logs, *rss_with_scans(log)), slam, job.access_points, config)
    geographic, radio, measured, heights = make_radio_maps(geographic, given, folder, progress)
    # ground truth -> metrics and report
    with folder.stage("report", progress):
        laser = log.robot_from_laser
        if job.truth_is_found:
            references, dropped = drop_other_times(references, slam.trajectory, laser)
            slam = replace(slam, notices=(*slam.notices, *dropped))
        references = references.or_truth(info.truth)
        known = (references, laser, ends, grid, geographic, radio, None, verdict)
        metrics = assess(Subject(slam.trajectory, *known, slam.covariances, slam.moving_share))
        set_aside(grid.probability)
        title = f"{job.paths[0].name}, {config.backend}"
        made = (log, slam, grid, geographic, radio, verdict, metrics, measured, heights)
        done = Run(title, config, info, *made)
        save_report(folder, done, references)
    return done


def _source(job: Job) -> Source:
    config = job.config
    how, seed = config.source_as_used(), config.seed
    return open_source(job.paths, how, config.simulation, seed=seed, section=config.section)


def _run_backend(
    source: Source, config: RunConfig, folder: RunFolder, progress: Progress, stop: Stop
) -> tuple[SlamBackend, ReadingLog]:
    """Run the backend over all readings, from the checkpoint on if there is one."""
    rng, log = np.random.default_rng(config.seed), ReadingLog()
    with folder.stage("loading", progress):
        backend = backends.make(config.backend, config, rng, progress.say)
        freeze_garbage_collector()
    with folder.stage("slam", progress):
        had_before = _restore(backend, folder)
        checkpoint = Checkpoint(
            folder,
            config.checkpoint,
            lambda: SavedStates({"backend": backend.snapshot()}, {"readings": len(log)}),
        )
        feed(source, backend, log, checkpoint, progress, stop, had_before=had_before)
    with folder.stage("reading", progress):
        save_readings(folder, log)
    return backend, log


def _moved_to_start(slam: SlamResult, truth: Trajectory | None) -> SlamResult:
    """Move a result to the known start pose; unchanged where the start is not known.

    Parameters
    ----------
    slam : SlamResult
        In the backend's own map frame.
    truth : Trajectory or None
        `map_from_robot` as the source knows it.
    """
    if truth is None or not len(truth):
        return slam
    mine_from_robot = Pose2.from_array(slam.trajectory.poses[0])
    start = Pose2.from_array(truth.at(slam.trajectory.stamps_ns[:1])[0])
    return slam.transformed(start @ mine_from_robot.inverse())


def check_consistency(
    log: ReadingLog, slam: SlamResult, folder: RunFolder, progress: Progress
) -> Contradictions:
    """Check the consistency of a trajectory and write the verdict."""
    with folder.stage("consistency", progress):
        verdict = check_slam(log, slam)
        save_consistency(folder, verdict)
    return verdict


def make_radio_maps(
    geographic: GeographicMap, given: RadioInput, folder: RunFolder, progress: Progress
) -> RadioMaps:
    """Make the predicted radio map (with access points) and the measured one (with readings).

    Readings first correct uncertain heights of the geographic map.
    """
    radio = measured = None
    heights: tuple[HeightPosterior, ...] = ()
    if given.logs:
        with folder.stage("heights heard", progress):
            geographic, heights = correct_heights(geographic, given, progress.say)
            if heights:
                save_heights(folder, heights)
                save_geographic(folder, geographic, given.config.mapping.large_image)
    if given.access_points:
        with folder.stage("radio map", progress):
            radio = predicted_radio_map(geographic, given.access_points, given.config)
            save_radio(folder, radio, given.config.radio)
    if given.logs:
        with folder.stage("measured radio map", progress):
            measured = measured_map(geographic, given, progress.say)
            save_measured(folder, measured)
    return geographic, radio, measured, heights


def _restore(backend: SlamBackend, folder: RunFolder) -> int:
    """Restore a backend from the checkpoint; return how many readings it has had."""
    with saved_states(folder.path) as saved:
        if saved is None:
            return 0
        backend.restore(saved.states["backend"])
        return int(saved.facts["readings"])
