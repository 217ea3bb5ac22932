# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The flow: recording -> readings -> SLAM -> geographic map -> radio map -> report."""

from __future__ import annotations

import numpy as np

from slarm_graph import backends
from slarm_graph.app.checkpoint import Checkpoint, resume_from
from slarm_graph.app.ending import Stop
from slarm_graph.app.feeding import feed
from slarm_graph.app.job import Job, Run
from slarm_graph.app.judging import judge
from slarm_graph.app.measuring import measured_map, save_measured, signal_logs
from slarm_graph.app.outputs import (
    save_consistency,
    save_geographic,
    save_radio,
    save_readings,
    save_slam,
    save_trajectory,
)
from slarm_graph.app.placing import placed
from slarm_graph.app.progress import Progress
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.app.run_report import save_report
from slarm_graph.backend import SlamBackend
from slarm_graph.eval.assessment import assess, read_references
from slarm_graph.eval.metric_parts import Subject
from slarm_graph.files.states import SavedStates
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.mapping import end_points_m, render, thinned
from slarm_graph.radio.measured.log import heard_with
from slarm_graph.radio.propagation.over_map import predicted_radio_map
from slarm_graph.reading_log import ReadingLog
from slarm_graph.recovery.recover import recover

_ENOUGH_POINTS = 1_000_000
"""Returns kept for walls and figures: 16 MB, several to each cell of a wall in kilometres of
walls."""


def run(job: Job, folder: RunFolder, progress: Progress) -> Run:
    """Do the whole job; every file is in the folder as soon as it is known.

    Parameters
    ----------
    job : Job
    folder : RunFolder
        A checkpoint in it is continued.
    progress : Progress

    Raises
    ------
    BadInput, RunFailed
        When there is nothing to show for it.
    """
    config, rng = job.config, np.random.default_rng(job.config.seed)
    stop = Stop(config.limits)
    references = read_references(job.ground_truth, job.relations)
    # recording -> readings
    with folder.stage("reading", progress):
        signals = signal_logs(job.rss, job.paths)
        source = open_source(
            job.paths,
            config.source_as_used(),
            config.simulation,
            seed=config.seed,
            section=config.section,
        )
    with folder.stage("loading", progress):
        backend = backends.make(config.backend, config, rng, progress.say)
    # readings -> SLAM backend
    with folder.stage("slam", progress):
        log, had_before = ReadingLog(), _restored(backend, folder)
        checkpoint = Checkpoint(
            folder,
            config.checkpoint.every_s,
            lambda: SavedStates({"backend": backend.snapshot()}, {"readings": len(log)}),
        )
        feed(source, backend, log, checkpoint, progress, stop, had_before=had_before)
        info = source.info()
    with folder.stage("reading", progress):
        save_readings(folder, log)
    # SLAM backend -> trajectory and occupancy grid
    with folder.stage("optimisation and map", progress):
        slam = placed(backend.result(), info.truth)
        save_trajectory(folder, "trajectory", slam.trajectory)
        progress.say(f"rendering {len(log)} scans")
        grid = render(log.scans, slam.trajectory, config.mapping)
        save_slam(folder, slam, grid)
    # trajectory -> does it contradict itself
    with folder.stage("consistency", progress):
        verdict = judge(log, slam.trajectory)
        save_consistency(folder, verdict)
    # occupancy grid -> geographic map (GGMR)
    with folder.stage("recovery", progress):
        ends = thinned(end_points_m(log.scans, slam.trajectory, config.mapping), _ENOUGH_POINTS)
        geographic = recover(grid, slam.trajectory, config.recovery, end_points=ends)
        save_geographic(folder, geographic)
    # geographic map -> radio map
    with folder.stage("radio map", progress):
        aps = job.access_points
        radio = predicted_radio_map(geographic, aps, config) if aps else None
        save_radio(folder, radio, config.radio)
    # readings of signal strength -> measured radio map
    with folder.stage("measured radio map", progress):
        heard = (*signals, *heard_with(log))
        measured = measured_map(heard, slam, geographic, aps, config, progress.say)
        save_measured(folder, measured)
    # what is known to be true -> metrics and report
    with folder.stage("report", progress):
        references = references.or_truth(info.truth)
        metrics = assess(
            Subject(
                slam.trajectory,
                references,
                log.robot_from_laser,
                ends,
                grid,
                geographic,
                radio,
                consistency=verdict,
            )
        )
        title = f"{job.paths[0].name}, {config.backend}"
        done = Run(
            title, config, info, log, slam, grid, geographic, radio, verdict, metrics, measured
        )
        save_report(folder, done, references)
    return done


def _restored(backend: SlamBackend, folder: RunFolder) -> int:
    """Bring a backend to where a checkpoint was written; return how many readings it has had."""
    had = 0

    def resume(saved: SavedStates) -> None:
        """Take the one state that a run has."""
        nonlocal had
        backend.restore(saved.states["backend"])
        had = int(saved.facts["readings"])

    resume_from(folder.path, resume)
    return had
