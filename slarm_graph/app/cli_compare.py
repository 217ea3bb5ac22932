# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands `compare` and `demo`: many runs, and tables of their metrics."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slarm_graph.app.ending import FAILED, OK
from slarm_graph.app.options import (
    AccessPoints,
    ConfigFile,
    Jobs,
    Name,
    Out,
    Overwrite,
    Settings,
    access_points,
)
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.app.external import External
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.app.trials import Trial
    from slarm_graph.eval.comparison import Outcome

_DEMO_BACKENDS = ("pose_graph", "gmapping")
_DEMO_LIMIT_S = 1200
"""Three times what the drive takes: a demo ends whatever happens."""

Sources = Annotated[
    list[str], typer.Argument(metavar="SOURCE...", help="Recordings or worlds (YAML file or name).")
]
Backends = Annotated[str, typer.Option(metavar="A,B", help="SLAM backends, separated by commas.")]
Seeds = Annotated[int, typer.Option(min=1, help="Number of seeds per setting: 0, 1, ...")]
Sweep = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=V1,V2", help="Run with each of these values of a setting; repeatable."
    ),
]
Externals = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=TUM[,MAP]",
        help="Trajectory (and map) of another system, to be evaluated too; with several sources"
        " NAME@SOURCE=TUM[,MAP]; repeatable.",
    ),
]
GroundTruths = Annotated[
    list[Path] | None,
    typer.Option(help="Ground-truth trajectory: one for all sources or one each, or `none`."),
]
RelationsFiles = Annotated[
    list[Path] | None,
    typer.Option(help="True relative poses: one for all sources or one each, or `none`."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Run on this dask scheduler's cluster, not locally."),
]
Upload = Annotated[
    bool,
    typer.Option("--upload", help="Send sources to dask workers without access to these files."),
]
Budget = Annotated[
    float | None, typer.Option(metavar="MINUTES", help="Start no further run after this time.")
]


def demo_command(out: Out = Path("runs"), name: Name = None, overwrite: Overwrite = False) -> int:
    """Explore the paper's room with both backends and compare; takes a minute or two."""
    from slarm_graph.app.compare import compare
    from slarm_graph.app.comparison_folder import open_comparison
    from slarm_graph.app.comparison_plan import ComparisonPlan, find_sources

    folder = open_comparison(out, name, overwrite=overwrite)
    print("A simulated robot explores the paper's room, once with each SLAM backend ...")
    limit = (f"explore.mission_time_s={_DEMO_LIMIT_S}",)
    plan = ComparisonPlan(find_sources(["paper_room"]), _DEMO_BACKENDS, 1, settings=limit)
    what = "The paper's room, explored in closed loop"
    return _compare(plan.trials(folder.path), folder, what, compare)


def compare_command(
    sources: Sources,
    backends: Backends = "odometry,gmapping,pose_graph",
    seeds: Seeds = 1,
    sweep: Sweep = None,
    external: Externals = None,
    ground_truth: GroundTruths = None,
    relations: RelationsFiles = None,
    scheduler: Scheduler = None,
    upload: Upload = False,
    budget: Budget = None,
    jobs: Jobs = None,
    ap: AccessPoints = None,
    out: Out = Path("runs"),
    name: Name = None,
    config: ConfigFile = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
) -> int:
    """Run every source with every backend, setting and seed, and compare.

    Repeated with the same --name, the command only does the runs that are missing.
    """
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.app.compare import compare
    from slarm_graph.app.comparison_folder import open_comparison
    from slarm_graph.app.comparison_plan import ComparisonPlan, find_sources
    from slarm_graph.app.external import find_externals
    from slarm_graph.files.configs import load_config

    if upload and scheduler is None:
        raise BadInput("--upload sends sources to a cluster's workers: it needs --scheduler")
    if budget is not None and not budget >= 0.0:
        raise BadInput(f"--budget {budget:g}: minutes, 0 or more")
    every, swept, points = tuple(settings or ()), tuple(sweep or ()), tuple(_points(ap or ()))
    access_points(ap or (), load_config(config, every))
    found = find_sources(sources, ground_truth, relations)
    show_notices(text for source in found for text in source.truth.found)
    plan = ComparisonPlan(found, _chosen(backends), seeds, config, every, swept, points)
    others = find_externals(external or (), found)
    plan.trials(out)  # what is wrong with it is told before there is a folder
    folder = open_comparison(out, name, overwrite=overwrite)
    counted = ((len(found), "source"), (len(plan.backends), "backend"), (seeds, "seed"))
    what = ", ".join(count_of(n, word) for n, word in counted)
    budget_s = None if budget is None else 60.0 * budget
    run = partial(compare, workers=jobs, scheduler=scheduler, upload=upload, budget_s=budget_s)
    return _compare(plan.trials(folder.path), folder, what, run, others)


def _points(given: Sequence[str]) -> list[str]:
    """Return access points as command-line arguments of the single runs."""
    return [word for point in given for word in ("--ap", *point.replace(",", " ").split())]


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
    run: Callable[..., tuple[Outcome, ...]],
    others: Sequence[External] = (),
) -> int:
    """Carry out trials, print and write the comparison; return 1 when one of them failed."""
    from slarm_graph.app.execution import record_early_end
    from slarm_graph.app.external import measure

    _print_done(planned)
    with record_early_end(folder):
        measured = [measure(other, folder.path, planned) for other in others]
        outcomes = _run_trials(planned, folder, what, run, measured)
        # Only now is known where the laser sits.
        measured = [measure(other, folder.path, planned) for other in others]
        _show(folder, [*outcomes, *measured], what)
    if any(outcome.status == "missing" for outcome in outcomes):
        _print_resume_command(folder)
    return OK if all(outcome.status == "ok" for outcome in outcomes) else FAILED


def _run_trials(
    planned: Sequence[Trial],
    folder: RunFolder,
    what: str,
    run: Callable[..., tuple[Outcome, ...]],
    measured: Sequence[Outcome],
) -> tuple[Outcome, ...]:
    """Run trials; on an interrupt show the results so far, and how to continue."""
    from slarm_graph.app.progress import show_progress

    done: list[Outcome] = []

    def tell(outcome: Outcome) -> None:
        """Keep an outcome, in case of an interrupt, and print it."""
        done.append(outcome)
        _print_outcome(outcome)

    try:
        with show_progress() as progress:
            return run(planned, tell=tell, progress=progress)
    except KeyboardInterrupt:
        if done:
            _show(
                folder,
                [*done, *measured],
                f"{what}, interrupted after {len(done)} of {count_of(len(planned), 'run')}",
            )
        _print_resume_command(folder)
        raise


def _print_done(planned: Sequence[Trial]) -> None:
    there = sum(trial.is_done() for trial in planned)
    if there:
        left = len(planned) - there
        print(
            f"{there} of {count_of(len(planned), 'run')} done already, {left} left", file=sys.stderr
        )


def _print_resume_command(folder: RunFolder) -> None:
    """Print the command that does the missing runs."""
    # Not what replaces the runs that are there, or starts none.
    words = _without_budget([word for word in sys.argv[1:] if word != "--overwrite"])
    if "--name" not in words:
        words += ["--name", folder.path.name]
    print(f"slarm: go on with: slarm {shlex.join(words)}", file=sys.stderr)


def _without_budget(words: Sequence[str]) -> list[str]:
    pairs = zip(words, ["", *words], strict=False)
    return [word for word, before in pairs if "--budget" not in (before, word.partition("=")[0])]


def _show(folder: RunFolder, outcomes: Sequence[Outcome], what: str) -> None:
    from slarm_graph.app.cli_output import show_text_table
    from slarm_graph.app.comparison_folder import write_comparison

    for table in write_comparison(folder, outcomes, what):
        show_text_table(table)
    good = sum(outcome.status == "ok" for outcome in outcomes)
    print(f"{what}; {good} of {count_of(len(outcomes), 'run')} ok -> {folder.path}/report.html")


def _print_outcome(outcome: Outcome) -> None:
    about = outcome.problem or f"{outcome.figures.get('wall_s', 0.0):.1f} s"
    print(f"{outcome.source} {outcome.variant} seed {outcome.seed}: {outcome.status} ({about})")
