# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands that run the whole flow once: run a recording, explore a world."""

from __future__ import annotations

import json
import logging
import math
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from slarm_graph.errors import BadInput, brief

if TYPE_CHECKING:
    from slarm_graph.access_points import AccessPoint
    from slarm_graph.app.job import ExploreJob, Job, Run
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.config import RunConfig
    from slarm_graph.world import WorldMap

_log = logging.getLogger(__name__)

POINT_OPTIONS = ("--ap",)

_INTERRUPTED, _FAILED = 130, 1
"""Exit codes as the README tells them; 130 is what shells give for 128 + SIGINT."""

Backend = Annotated[
    str | None, typer.Option("--backend", "-b", help="SLAM backend; `slarm backends` lists them.")
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for run folders.")]
Name = Annotated[str | None, typer.Option("--name", help="Name of the run folder in it.")]
AccessPoints = Annotated[
    list[str] | None,
    typer.Option("--ap", metavar="X Y Z", help="Access point in the map, in m; repeatable."),
]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", "-c", help="YAML with any of the keys of `slarm config`.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="One key, such as mapping.resolution_m=0.1."),
]
Odom = Annotated[
    str | None, typer.Option("--odom", metavar="TOPIC|none", help="Odometry topic, or none.")
]
Scan = Annotated[str | None, typer.Option("--scan", metavar="TOPIC", help="Which laser to use.")]
Segment = Annotated[int | None, typer.Option(help="Which part, when the clock jumps back; from 1.")]
StaticTf = Annotated[
    list[str] | None,
    typer.Option(metavar="'PARENT CHILD X Y Z YAW'", help="A missing fixed transform [m, rad]."),
]
GroundTruth = Annotated[
    Path | None,
    typer.Option("--ground-truth", help="True trajectory (TUM, EuRoC ...), or none."),
]
Resume = Annotated[
    Path | None, typer.Option("--resume", metavar="DIR", help="Go on with an unfinished run.")
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace what an earlier run of that name left.")
]
MaxTime = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Read no longer than this, then end with what is known."),
]
MaxMemory = Annotated[
    float | None,
    typer.Option(metavar="MB", help="Never need more memory than this; end with what is known."),
]
RelationsFile = Annotated[
    Path | None,
    typer.Option("--relations", help="True relative poses (Freiburg benchmark), or none."),
]

Rss = Annotated[
    list[str] | None,
    typer.Option(
        "--rss",
        metavar="FILE|/TOPIC:FIELD[,NAME...]",
        help="Readings of signal strength: CSV (stamp, ap, rss_dbm; empty: not heard), a log of"
        " Bluetooth anchors, or a topic's numeric field and those that name the access point;"
        " repeatable. A NAME_ble.txt beside NAME_scan.txt is found by itself.",
    ),
]


def run_command(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="SOURCE...",
            help="A recording: .bag (several count as one), ROS 2 folder, metadata.yaml, .mcap,"
            " .db3, or CARMEN .clf/.log[.gz]; or a world (YAML or name), to be driven through.",
        ),
    ] = None,
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
    seed: Seed = None,
    config: ConfigFile = None,
    settings: Settings = None,
    resume: Resume = None,
    overwrite: Overwrite = False,
    max_time: MaxTime = None,
    max_memory: MaxMemory = None,
    no_csv: Annotated[bool, typer.Option("--no-csv", help="Leave radio_map.csv out.")] = False,
    show: Annotated[
        bool, typer.Option("--open", help="Show the report in the browser when it is done.")
    ] = False,
) -> int:
    """Turn a recording into a trajectory, maps, a radio map and a report."""
    overrides = [
        *(settings or ()),
        *_set("backend", backend),
        *_set("seed", seed),
        *source_settings(odom, scan, segment, static_tf),
        *_limit_settings(max_time, max_memory),
        *_set("radio.csv_most_lines", 0 if no_csv else None),
    ]
    if resume is not None:
        return _resume(resume, config, overrides, show)
    if not sources:
        raise BadInput("no recording given: slarm run SOURCE, or slarm demo for a simulated one")
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.app.job import Job
    from slarm_graph.app.known_truth import known_truth
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.files.configs import load_config
    from slarm_graph.frontends.recordings.sources import existing_paths

    resolved = load_config(config, overrides)
    paths = tuple(existing_paths(sources))
    points = access_points(ap or (), resolved) or _of_world(paths)
    truth = known_truth(paths[0], ground_truth, relations)
    show_notices(truth.found)
    job = Job(paths, resolved, points, truth.ground_truth, truth.relations, tuple(rss or ()))
    return _execute(job, create_run_folder(out, name, overwrite=overwrite), show)


def source_settings(
    odom: str | None, scan: str | None, segment: int | None, static_tf: list[str] | None
) -> list[str]:
    """Return the options that choose what to read of a recording as `KEY=VALUE`."""
    return [
        *_set("source.odom", odom),
        *_set("source.scan_topic", scan),
        *_set("source.segment", segment),
        *_set("source.static_tf", static_tf or None),
    ]


def _limit_settings(max_time: float | None, max_memory: float | None) -> list[str]:
    return [*_set("limits.max_time_s", max_time), *_set("limits.max_memory_mb", max_memory)]


def source_config(
    odom: str | None,
    scan: str | None,
    segment: int | None,
    static_tf: list[str] | None,
    config: Path | None,
    settings: list[str] | None,
) -> RunConfig:
    """Return what the options of `check` and `convert` say of how to read a recording."""
    from slarm_graph.files.configs import load_config

    chosen = [*(settings or ()), *source_settings(odom, scan, segment, static_tf)]
    return load_config(config, chosen)


def access_points(given: Sequence[str], config: RunConfig) -> tuple[AccessPoint, ...]:
    """Build access points AP1, AP2, ... from texts `X Y Z` [m]."""
    from slarm_graph.access_points import AccessPoint

    points = []
    for number, text in enumerate(given, start=1):
        try:
            x, y, z = (float(word) for word in text.replace(",", " ").split())
        except ValueError:
            raise BadInput(f"--ap {text}: expected three numbers X Y Z [m]") from None
        if not all(map(math.isfinite, (x, y, z))) or z < 0.0:
            raise BadInput(f"--ap {text}: X Y Z must be finite, and Z not below the floor [m]")
        radio = config.radio
        points.append(AccessPoint(f"AP{number}", x, y, z, radio.power_dbm, radio.frequency_hz))
    return tuple(points)


def _of_world(paths: Sequence[Path]) -> tuple[AccessPoint, ...]:
    """Return the access points that a world has of its own; a recording has none."""
    from slarm_graph.frontends.recordings.sources import open_world

    world = open_world(paths)
    return () if world is None else world.map.access_points


def _set(key: str, value: object) -> list[str]:
    """Return an option as an override of the configuration; JSON is YAML."""
    return [] if value is None else [f"{key}={json.dumps(value)}"]


def _resume(path: Path, config: Path | None, overrides: Sequence[str], show: bool = False) -> int:
    from slarm_graph.app.resuming import resumed_job
    from slarm_graph.app.run_folder import open_run_folder

    job = resumed_job(path, config, overrides)
    return _execute(job, open_run_folder(path), show)


def _execute(job: Job | ExploreJob, folder: RunFolder, show: bool = False) -> int:
    from slarm_graph.app.execution import execute
    from slarm_graph.app.progress import shown

    with shown() as progress:
        run = execute(job, folder, progress)
    if show:
        webbrowser.open((folder.path / "report.html").resolve().as_uri())
    return _finish(run, folder)


def explore_command(
    world: Annotated[
        str, typer.Option(help="YAML file of a world, or one that comes along.")
    ] = "paper_room",
    backend: Backend = None,
    explorer: Annotated[str | None, typer.Option(help="Who decides where to drive.")] = None,
    resolution: Annotated[
        float | None, typer.Option(help="Side of the maps' cells, in m (the paper's delta).")
    ] = None,
    speed: Annotated[float | None, typer.Option(help="Of the robot, in m/s.")] = None,
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
    """Let a simulated robot explore a world, and measure the maps against the truth."""
    from slarm_graph.app.job import ExploreJob
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.files.configs import load_config
    from slarm_graph.files.worlds import load_world

    overrides = [
        *(settings or ()),
        *_set("backend", backend),
        *_set("seed", seed),
        *_set("explore.explorer", explorer),
        *_set("explore.resolution_m", resolution),
        *_set("explore.driving.speed_m_s", speed),
        *_limit_settings(max_time, max_memory),
    ]
    if resume is not None:
        return _resume(resume, config, overrides)
    resolved, found = load_config(config, overrides), load_world(world)
    _announce(found)
    job = ExploreJob(found, resolved)
    return _execute(job, create_run_folder(out, name, overwrite=overwrite))


def _announce(world: WorldMap) -> None:
    """Say before anything is driven what is amiss with a world."""
    from slarm_graph.files.world_checks import world_warnings

    if not world.access_points:
        raise BadInput(
            f"{brief(world.name)} has no access points, and exploring ends in a radio map; add "
            "`access_points: [{name: AP1, x_m: 0, y_m: 0, z_m: 2.5}]` to its file"
        )
    for warning in world_warnings(world):
        _log.warning(warning)


def _finish(run: Run, folder: RunFolder) -> int:
    """Show a run and turn how it ended into an exit code."""
    _show(run, folder)
    if not run.log.problem:
        return 0
    from slarm_graph.app.execution import partial_lines

    for line in partial_lines(folder.path, run.log.problem):
        print(f"slarm: {line}", file=sys.stderr)
    return _INTERRUPTED if run.log.interrupted else _FAILED


def _show(run: Run, folder: RunFolder) -> None:
    from slarm_graph.app.cli_output import show_metrics, show_notices, show_scans

    show_notices((*run.consistency.notices(), *run.info.notices, *run.slam.notices))
    show_scans(run.log.statuses())
    show_metrics(run.metrics, title=run.title)
    print(f"verdict: {run.consistency.summary()}")
    seconds = cast(float, folder.record()["wall_s"])
    print(f"{len(run.log)} scans in {seconds:.1f} s -> {folder.path}/report.html")
