# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands that run many: compare backends, demo, reproduce the paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slarm_graph.app.cli_run import (
    AccessPoints,
    ConfigFile,
    Name,
    Out,
    Overwrite,
    Settings,
    access_points,
)
from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.app.trials import Trial
    from slarm_graph.eval.comparison import Outcome

_FAILED = 1
"""Exit code of a comparison in which a trial failed, as the README tells."""
_DEMO_BACKENDS = ("pose_graph", "gmapping")
_DEMO_LIMIT_S = 1200
"""Three times what the drive takes: a demo ends whatever happens."""


def demo_command(out: Out = Path("runs"), name: Name = None, overwrite: Overwrite = False) -> int:
    """Explore the paper's room with both backends and compare; takes a minute or two."""
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.app.trials import find_sources, trials

    folder = create_run_folder(out, name, overwrite=overwrite)
    print("A simulated robot explores the paper's room, once with each SLAM backend ...")
    limit = ("--set", f"explore.mission_time_s={_DEMO_LIMIT_S}")
    room = find_sources(["paper_room"])
    planned = trials(room, _DEMO_BACKENDS, 1, folder.path, options=limit)
    return _compare(planned, folder, "The paper's room, explored in closed loop")


def reproduce_command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer resolutions, one speed, one seed.")
    ] = False,
    seeds: Annotated[int | None, typer.Option(min=1, help="Seeds per setting.")] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, help="Processes at a time.")
    ] = None,
    out: Out = Path("runs"),
    name: Name = None,
    overwrite: Overwrite = False,
) -> None:
    """Make the paper's figures and table, and show them beside the paper's."""
    from dataclasses import replace

    from slarm_graph.app.execution import early_end_noted
    from slarm_graph.app.reproduce import QUICK, Plan, reproduce
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.eval.gallery_page import gallery_html

    plan = QUICK if quick else Plan()
    plan = plan if seeds is None else replace(plan, seeds=seeds)
    folder = create_run_folder(out, name, overwrite=overwrite)
    with early_end_noted(folder):
        rows = reproduce(folder.path, plan, jobs=jobs, tell=print)
    lead = f"{len(rows)} closed loops in the paper's room; resolutions in m, speeds in m/s"
    pictures = sorted(path.name for path in folder.path.glob("*.png"))
    tables = ("summary.csv", "hypotheses.csv", "complexity.csv", "results.csv")
    page = gallery_html(folder.path, "The paper's figures, reproduced", lead, pictures, tables)
    folder.write_text("report.html", page)
    folder.note(status="ok", runs=len(rows))
    print(f"{len(rows)} closed loops -> {folder.path}/report.html")


def compare_command(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help="Recordings, and worlds (YAML or name)."),
    ],
    backends: Annotated[
        str, typer.Option(metavar="A,B", help="Backends, with commas between them.")
    ] = "odometry,gmapping,pose_graph",
    seeds: Annotated[int, typer.Option(min=1, help="Number of seeds: 0, 1, ...")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a dask scheduler; else this machine.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, help="Processes at a time.")
    ] = None,
    ap: AccessPoints = None,
    out: Out = Path("runs"),
    name: Name = None,
    config: ConfigFile = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
) -> int:
    """Run every source with every backend and seed, and compare."""
    from slarm_graph import parts
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.app.trials import find_sources, trials
    from slarm_graph.files.configs import load_config

    chosen = [word.strip() for word in backends.split(",") if word.strip()]
    if not chosen:
        raise BadInput(f"--backends names none; there are {', '.join(parts.registered('backend'))}")
    for backend in chosen:
        parts.find("backend", backend)
    access_points(ap or (), load_config(config, settings or ()))
    found = find_sources(sources)
    folder = create_run_folder(out, name, overwrite=overwrite)
    points = [word for point in ap or () for word in ("--ap", *point.replace(",", " ").split())]
    options = [
        *(("--config", str(config.resolve())) if config else ()),
        *(word for setting in settings or () for word in ("--set", setting)),
    ]
    planned = trials(found, chosen, seeds, folder.path, options=options, for_recordings=points)
    what = f"{len(found)} sources, {len(chosen)} backends, {seeds} seeds"
    return _compare(planned, folder, what, jobs, scheduler)


def _compare(
    planned: Sequence[Trial],
    folder: RunFolder,
    what: str,
    jobs: int | None = None,
    scheduler: str | None = None,
) -> int:
    """Carry trials out, show and write the comparison; 1 when one of them failed."""
    from slarm_graph.app.cli_output import show_comparison
    from slarm_graph.app.compare import compare
    from slarm_graph.app.execution import early_end_noted
    from slarm_graph.app.progress import shown

    done: list[Outcome] = []

    def tell(outcome: Outcome) -> None:
        """Keep an outcome for when the rest does not come, and print it."""
        done.append(outcome)
        _tell_outcome(outcome)

    with early_end_noted(folder):
        try:
            with shown() as progress:
                outcomes = compare(
                    planned, workers=jobs, scheduler=scheduler, tell=tell, progress=progress
                )
        except KeyboardInterrupt:
            if done:
                show_comparison(folder, done, f"{what}, interrupted")
            raise
        show_comparison(folder, outcomes, what)
    return 0 if all(outcome.status == "ok" for outcome in outcomes) else _FAILED


def _tell_outcome(outcome: Outcome) -> None:
    about = outcome.problem or f"{outcome.figures.get('wall_s', 0.0):.1f} s"
    print(f"{outcome.source} {outcome.backend} seed {outcome.seed}: {outcome.status} ({about})")
