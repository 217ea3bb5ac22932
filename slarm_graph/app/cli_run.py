# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands `run` (a recording) and `explore` (a world): the whole flow, once."""

from __future__ import annotations

import logging
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from slarm_graph.app.ending import FAILED, INTERRUPTED
from slarm_graph.app.options import (
    AccessPoints,
    Backend,
    ConfigFile,
    GroundTruth,
    MaxMemory,
    MaxTime,
    Name,
    Odom,
    Out,
    Overwrite,
    RelationsFile,
    Resume,
    RosDistro,
    Rss,
    Scan,
    Seed,
    Segment,
    Settings,
    StaticTf,
    access_points,
    limit_settings,
    overriding,
    source_settings,
)
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief

if TYPE_CHECKING:
    from slarm_graph.access_points import AccessPoint
    from slarm_graph.app.job import ExploreJob, Job, Run
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.config import RunConfig
    from slarm_graph.world import WorldMap

_log = logging.getLogger(__name__)

RunSources = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="SOURCE...",
        help="Recording: ROS 1 .bag (several are read as one), ROS 2 bag (folder, metadata.yaml,"
        " .mcap or .db3) or CARMEN log (.clf/.log[.gz]); or a world (YAML file or name), through"
        " which a simulated robot drives.",
    ),
]
NoCsv = Annotated[bool, typer.Option("--no-csv", help="Do not write radio_map.csv.")]
Open = Annotated[bool, typer.Option("--open", help="Open the report in the browser at the end.")]
World = Annotated[str, typer.Option(help="World: YAML file, or a name that `slarm worlds` lists.")]
_RADIO_GOAL = ("explore.explorer=radio-survey", "simulation.signals.rate_hz=5.0")
"""Five readings a second are usual for Bluetooth and for scans of one Wi-Fi channel."""

Goal = Annotated[
    Literal["map", "radio"],
    typer.Option(
        help="Explore to complete the map, or to measure signal strength until the radio map is"
        " certain (explorer radio-survey, 5 readings a second)."
    ),
]
Explorer = Annotated[str | None, typer.Option(help="Exploration method; see `slarm backends`.")]
Resolution = Annotated[
    float | None, typer.Option(help="Cell size of the maps, in m (the paper's delta).")
]
Speed = Annotated[float | None, typer.Option(help="Speed of the robot, in m/s.")]


def run_command(
    sources: RunSources = None,
    backend: Backend = None,
    ap: AccessPoints = None,
    out: Out = Path("runs"),
    name: Name = None,
    relations: RelationsFile = None,
    ground_truth: GroundTruth = None,
    rss: Rss = None,
    odom: Odom = None,
    scan: Scan = None,
    segment: Segment = None,
    static_tf: StaticTf = None,
    ros_distro: RosDistro = None,
    seed: Seed = None,
    config: ConfigFile = None,
    settings: Settings = None,
    resume: Resume = None,
    overwrite: Overwrite = False,
    max_time: MaxTime = None,
    max_memory: MaxMemory = None,
    no_csv: NoCsv = False,
    show: Open = False,
) -> int:
    """Turn a recording into a trajectory, maps, a radio map and a report."""
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.files.configs import load_config

    overrides = [
        *(settings or ()),
        *overriding("backend", backend),
        *overriding("seed", seed),
        *source_settings(odom, scan, segment, static_tf),
        *overriding("source.ros_distro", ros_distro),
        *limit_settings(max_time, max_memory),
        *overriding("radio.csv_most_lines", 0 if no_csv else None),
    ]
    if resume is not None:
        return _resume(resume, config, overrides, show)
    if not sources:
        raise BadInput("no recording given: slarm run SOURCE, or slarm demo for a simulated one")
    job = _job(sources, load_config(config, overrides), ap, (ground_truth, relations), rss)
    return _execute(job, create_run_folder(out, name, overwrite=overwrite), show)


def _job(
    sources: Sequence[Path],
    config: RunConfig,
    ap: Sequence[str] | None,
    known: tuple[Path | None, Path | None],
    rss: Sequence[str] | None,
) -> Job:
    """Make a job, with the ground truth found beside the recording; `known`: path, relations."""
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.app.job import Job
    from slarm_graph.app.reference_files import find_references
    from slarm_graph.frontends.recordings.sources import existing_paths

    paths = tuple(existing_paths(sources))
    points = access_points(ap or (), config) or _of_world(paths)
    truth = find_references(paths[0], *known)
    show_notices(truth.found)
    found = bool(truth.found) and known == (None, None)
    files = (truth.ground_truth, truth.relations)
    return Job(paths, config, points, *files, tuple(rss or ()), truth_is_found=found)


def _of_world(paths: Sequence[Path]) -> tuple[AccessPoint, ...]:
    """Return the access points of a world; a recording has none."""
    from slarm_graph.frontends.recordings.sources import open_world

    world = open_world(paths)
    return () if world is None else world.map.access_points


def _resume(path: Path, config: Path | None, overrides: Sequence[str], show: bool = False) -> int:
    from slarm_graph.app.resuming import resumed_job
    from slarm_graph.app.run_folder import open_run_folder

    job = resumed_job(path, config, overrides)
    return _execute(job, open_run_folder(path), show)


def _execute(job: Job | ExploreJob, folder: RunFolder, show: bool = False) -> int:
    from slarm_graph.app.execution import execute
    from slarm_graph.app.progress import show_progress

    with show_progress() as progress:
        run = execute(job, folder, progress)
    if show:
        webbrowser.open((folder.path / "report.html").resolve().as_uri())
    return _finish(run, folder)


def explore_command(
    world: World = "paper_room",
    backend: Backend = None,
    explorer: Explorer = None,
    goal: Goal = "map",
    resolution: Resolution = None,
    speed: Speed = None,
    seed: Seed = None,
    out: Out = Path("runs"),
    name: Name = None,
    config: ConfigFile = None,
    settings: Settings = None,
    resume: Resume = None,
    overwrite: Overwrite = False,
    max_time: MaxTime = None,
    max_memory: MaxMemory = None,
) -> int:
    """Explore a world with a simulated robot, and compare the maps with the ground truth."""
    from slarm_graph.app.job import ExploreJob
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.files.configs import load_config
    from slarm_graph.files.worlds import load_world

    overrides = [
        *(_RADIO_GOAL if goal == "radio" else ()),
        *(settings or ()),
        *overriding("backend", backend),
        *overriding("seed", seed),
        *overriding("explore.explorer", explorer),
        *overriding("explore.resolution_m", resolution),
        *overriding("explore.driving.speed_m_s", speed),
        *limit_settings(max_time, max_memory),
    ]
    if resume is not None:
        return _resume(resume, config, overrides)
    resolved, found = load_config(config, overrides), load_world(world)
    _check_world(found)
    job = ExploreJob(found, resolved)
    return _execute(job, create_run_folder(out, name, overwrite=overwrite))


def _check_world(world: WorldMap) -> None:
    """Warn of what is wrong with a world, before the drive."""
    from slarm_graph.files.world_checks import world_warnings

    if not world.access_points:
        raise BadInput(
            f"{brief(world.name)} has no access points, and exploring ends in a radio map; add "
            "`access_points: [{name: AP1, x_m: 0, y_m: 0, z_m: 2.5}]` to its file"
        )
    for warning in world_warnings(world):
        _log.warning(warning)


def _finish(run: Run, folder: RunFolder) -> int:
    """Print the results of a run and return the exit code."""
    _show(run, folder)
    if not run.log.problem:
        return 0
    for line in folder.resume_hints(run.log.problem):
        print(f"slarm: {line}", file=sys.stderr)
    return INTERRUPTED if run.log.interrupted else FAILED


def _show(run: Run, folder: RunFolder) -> None:
    from slarm_graph.app.cli_output import show_metrics, show_notices, show_scans
    from slarm_graph.app.run_report import uncertainty

    heard = run.measured.notices if run.measured else ()
    show_notices((*run.consistency.notices(), *run.info.notices, *run.slam.notices, *heard))
    show_scans(run.log.statuses())
    show_metrics(run.metrics, title=run.title)
    print(f"verdict: {run.consistency.summary()}{uncertainty(run.slam.covariances)}")
    seconds = cast(float, folder.record()["wall_s"])
    print(f"{count_of(len(run.log), 'scan')} in {seconds:.1f} s -> {folder.path}/report.html")
