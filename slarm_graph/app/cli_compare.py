# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands that run many: compare backends, demo, reproduce the paper."""

from __future__ import annotations

import shlex
import sys
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
    from slarm_graph.app.external import External
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.app.trials import Trial
    from slarm_graph.eval.comparison import Outcome

_FAILED = 1
"""Exit code where a run failed, as the README tells."""
_DEMO_BACKENDS = ("pose_graph", "gmapping")
_DEMO_LIMIT_S = 1200
"""Three times what the drive takes: a demo ends whatever happens."""


def demo_command(out: Out = Path("runs"), name: Name = None, overwrite: Overwrite = False) -> int:
    """Explore the paper's room with both backends and compare; takes a minute or two."""
    from slarm_graph.app.comparison_folder import open_comparison
    from slarm_graph.app.trials import ComparisonPlan, find_sources

    folder = open_comparison(out, name, overwrite=overwrite)
    print("A simulated robot explores the paper's room, once with each SLAM backend ...")
    limit = (f"explore.mission_time_s={_DEMO_LIMIT_S}",)
    plan = ComparisonPlan(find_sources(["paper_room"]), _DEMO_BACKENDS, 1, settings=limit)
    what = "The paper's room, explored in closed loop"
    return _compare(plan.trials(folder.path), folder, what)


def reproduce_command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer resolutions, one speed, one seed.")
    ] = False,
    explorer: Annotated[
        str | None, typer.Option(metavar="A,B", help="Explorers; ggmr is the paper's.")
    ] = None,
    prior: Annotated[
        str | None, typer.Option(help="Show only `extent` or `extent+sizes` (both).")
    ] = None,
    expansion: Annotated[
        str | None, typer.Option(metavar="A,B", help="R_e to show: cell, robot, zero (all).")
    ] = None,
    resolutions: Annotated[
        str | None, typer.Option(metavar="M,M", help="Sides of cells, in m.")
    ] = None,
    speeds: Annotated[str | None, typer.Option(metavar="V,V", help="Of the robot, in m/s.")] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Seeds per setting.")] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, help="Processes at a time.")
    ] = None,
    out: Out = Path("runs"),
    name: Name = None,
    overwrite: Overwrite = False,
) -> int:
    """Make the paper's figures and table; with --name a second time, only what is missing."""
    from slarm_graph.app.execution import early_end_noted
    from slarm_graph.app.progress import shown
    from slarm_graph.app.run_folder import create_run_folder, open_run_folder
    from slarm_graph.eval.gallery_page import gallery_html
    from slarm_graph.paper.options import plan_of
    from slarm_graph.paper.reproduce import reproduce

    plan = plan_of(quick, explorer, prior, expansion, resolutions, speeds, seeds)
    again = not overwrite and name is not None and (out / name / "runs").is_dir()
    folder = (
        open_run_folder(out / str(name))
        if again
        else create_run_folder(out, name, overwrite=overwrite)
    )
    with early_end_noted(folder), shown() as progress:
        outcomes = reproduce(folder.path, plan, jobs=jobs, tell=print, progress=progress)
    failed = sum(outcome.status != "ok" for outcome in outcomes)
    lead = (
        f"{len(outcomes)} closed loops in the paper's room, {failed} of them not finished;"
        " resolutions in m, speeds in m/s. With sizes: the robot is told the length, width and"
        " height of every wall and box, as Algorithm 1 is; without: nothing but the extent."
        " Comparisons are looks at one cell: the paper's O(N^3) and O(N (log N)^N) are bounds far"
        " above what is counted, which grows with the number of cells."
    )
    pictures = sorted(path.name for path in folder.path.glob("*.png"))
    tables = ("results.csv", "hypotheses.csv", "complexity.csv")
    page = gallery_html(folder.path, "The paper's figures, reproduced", lead, pictures, tables)
    folder.write_text("report.html", page)
    folder.note(status="partial" if failed else "ok", runs=len(outcomes))
    print(f"{len(outcomes)} closed loops -> {folder.path}/report.html")
    return _FAILED if failed else 0


def compare_command(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help="Recordings, and worlds (YAML or name)."),
    ],
    backends: Annotated[
        str, typer.Option(metavar="A,B", help="Backends, with commas between them.")
    ] = "odometry,gmapping,pose_graph",
    seeds: Annotated[int, typer.Option(min=1, help="Number of seeds: 0, 1, ...")] = 1,
    sweep: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=V1,V2", help="Run with every value of a setting; repeatable."),
    ] = None,
    external: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=TUM[,MAP]",
            help="Another system's result, in the same tables; of several sources NAME@SOURCE=...",
        ),
    ] = None,
    ground_truth: Annotated[
        list[Path] | None,
        typer.Option(help="True trajectory: one for all sources or one each; none for none."),
    ] = None,
    relations: Annotated[
        list[Path] | None,
        typer.Option(help="True relative poses: one for all sources or one each; none for none."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a dask scheduler; else this machine.")
    ] = None,
    upload: Annotated[
        bool,
        typer.Option("--upload", help="Send sources to workers that do not share this folder."),
    ] = False,
    budget: Annotated[
        float | None,
        typer.Option(metavar="MINUTES", help="Start no further run after that long."),
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
    """Run every source with every backend, setting and seed, and compare.

    The same command again with the same --name finishes only what is missing.
    """
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.app.comparison_folder import open_comparison
    from slarm_graph.app.external import find_externals
    from slarm_graph.app.trials import ComparisonPlan, find_sources
    from slarm_graph.files.configs import load_config

    access_points(ap or (), load_config(config, settings or ()))
    found = find_sources(sources, ground_truth, relations)
    show_notices(text for source in found for text in source.truth.found)
    points = [word for point in ap or () for word in ("--ap", *point.replace(",", " ").split())]
    plan = ComparisonPlan(
        found,
        _chosen(backends),
        seeds,
        config,
        tuple(settings or ()),
        tuple(sweep or ()),
        tuple(points),
    )
    others = find_externals(external or (), found)
    plan.trials(out)  # what is wrong with it is told before there is a folder
    folder = open_comparison(out, name, overwrite=overwrite)
    what = f"{len(found)} sources, {len(plan.backends)} backends, {seeds} seeds"
    return _compare(
        plan.trials(folder.path),
        folder,
        what,
        jobs=jobs,
        scheduler=scheduler,
        upload=upload,
        budget_s=None if budget is None else 60.0 * budget,
        others=others,
    )


def _chosen(backends: str) -> tuple[str, ...]:
    from slarm_graph import parts

    chosen = [word.strip() for word in backends.split(",") if word.strip()]
    if not chosen:
        raise BadInput(f"--backends names none; there are {', '.join(parts.registered('backend'))}")
    for backend in chosen:
        parts.find("backend", backend)
    return tuple(chosen)


def _compare(
    planned: Sequence[Trial],
    folder: RunFolder,
    what: str,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    upload: bool = False,
    budget_s: float | None = None,
    others: Sequence[External] = (),
) -> int:
    """Carry trials out, show and write the comparison; 1 when one of them failed."""
    from slarm_graph.app.compare import compare
    from slarm_graph.app.execution import early_end_noted
    from slarm_graph.app.external import measure
    from slarm_graph.app.progress import shown

    done: list[Outcome] = []

    def tell(outcome: Outcome) -> None:
        """Keep an outcome for when the rest does not come, and print it."""
        done.append(outcome)
        _tell_outcome(outcome)

    _tell_found(planned)
    with early_end_noted(folder):
        measured = [measure(other, folder.path, planned) for other in others]
        try:
            with shown() as progress:
                outcomes = compare(
                    planned,
                    workers=jobs,
                    scheduler=scheduler,
                    upload=upload,
                    budget_s=budget_s,
                    tell=tell,
                    progress=progress,
                )
        except KeyboardInterrupt:
            if done:
                _show(folder, [*done, *measured], f"{what}, interrupted")
            _tell_how_to_go_on(folder)
            raise
        # Only now is known where the laser sits.
        measured = [measure(other, folder.path, planned) for other in others]
        _show(folder, [*outcomes, *measured], what)
    if any(outcome.status == "missing" for outcome in outcomes):
        _tell_how_to_go_on(folder)
    return 0 if all(outcome.status == "ok" for outcome in outcomes) else _FAILED


def _tell_found(planned: Sequence[Trial]) -> None:
    there = sum(trial.is_done() for trial in planned)
    if there:
        left = len(planned) - there
        print(f"{there} of {len(planned)} runs are done already, {left} left", file=sys.stderr)


def _tell_how_to_go_on(folder: RunFolder) -> None:
    """Print the command that finishes what is missing."""
    words = list(sys.argv[1:])
    if "--name" not in words:
        words += ["--name", folder.path.name]
    print(f"slarm: go on with: slarm {shlex.join(words)}", file=sys.stderr)


def _show(folder: RunFolder, outcomes: Sequence[Outcome], what: str) -> None:
    from slarm_graph.app.cli_output import show_text_table
    from slarm_graph.app.comparison_folder import write_comparison

    for table in write_comparison(folder, outcomes, what):
        show_text_table(table)
    good = sum(outcome.status == "ok" for outcome in outcomes)
    print(f"{what}; {good} of {len(outcomes)} runs ok -> {folder.path}/report.html")


def _tell_outcome(outcome: Outcome) -> None:
    about = outcome.problem or f"{outcome.figures.get('wall_s', 0.0):.1f} s"
    print(f"{outcome.source} {outcome.variant} seed {outcome.seed}: {outcome.status} ({about})")
