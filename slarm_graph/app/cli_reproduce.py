# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command `reproduce`: the paper's figures and table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slarm_graph.app.ending import FAILED, OK
from slarm_graph.app.options import Jobs, Name, Out, Overwrite

if TYPE_CHECKING:
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.eval.comparison import Outcome

_LEAD = (
    "closed loops in the paper's room, {failed} of them not finished;"
    " resolutions in m, speeds in m/s. With sizes: the robot is told the length, width and"
    " height of every wall and box, as Algorithm 1 is; without: nothing but the extent."
    " Comparisons are looks at one cell: the paper's O(N^3) and O(N (log N)^N) are bounds far"
    " above what is counted, which grows with the number of cells."
)
_TABLES = ("results.csv", "hypotheses.csv", "complexity.csv")

Quick = Annotated[bool, typer.Option("--quick", help="Fewer resolutions, one speed, one seed.")]
Explorers = Annotated[
    str | None,
    typer.Option("--explorer", metavar="A,B", help="Exploration methods; ggmr is the paper's."),
]
Prior = Annotated[
    str | None, typer.Option(help="Prior to show: extent or extent+sizes; default: both.")
]
Expansion = Annotated[
    str | None, typer.Option(metavar="A,B", help="R_e to show: cell, robot, zero; default: all.")
]
Resolutions = Annotated[str | None, typer.Option(metavar="M,M", help="Cell sizes, in m.")]
Speeds = Annotated[str | None, typer.Option(metavar="V,V", help="Robot speeds, in m/s.")]
SeedsPerSetting = Annotated[int | None, typer.Option(min=1, help="Seeds per setting.")]
Drives = Annotated[
    list[Path] | None,
    typer.Option(help="drives.csv of another reproduction: not driven again; may be repeated."),
]


def reproduce_command(
    quick: Quick = False,
    explorer: Explorers = None,
    prior: Prior = None,
    expansion: Expansion = None,
    resolutions: Resolutions = None,
    speeds: Speeds = None,
    seeds: SeedsPerSetting = None,
    drives: Drives = None,
    jobs: Jobs = None,
    out: Out = Path("runs"),
    name: Name = None,
    overwrite: Overwrite = False,
) -> int:
    """Reproduce the paper's figures and table.

    Repeated with the same --name, the command only does the runs that are missing.
    """
    from slarm_graph.app.execution import record_early_end
    from slarm_graph.app.progress import show_progress
    from slarm_graph.paper.plan import plan_of
    from slarm_graph.paper.reproduce import reproduce

    plan = plan_of(quick, explorer, prior, expansion, resolutions, speeds, seeds)
    folder = _folder(out, name, overwrite)
    with record_early_end(folder), show_progress() as progress:
        outcomes = reproduce(
            folder.path, plan, elsewhere=drives or (), jobs=jobs, tell=print, progress=progress
        )
    return _write_page(folder, outcomes)


def _folder(out: Path, name: str | None, overwrite: bool) -> RunFolder:
    """Open the folder of a reproduction that was begun under that name, or make one."""
    from slarm_graph.app.run_folder import create_run_folder, open_run_folder, was_begun

    if not overwrite and name is not None and was_begun(out / name, "reproduction"):
        return open_run_folder(out / name)
    return create_run_folder(out, name, overwrite=overwrite, kind="reproduction")


def _write_page(folder: RunFolder, outcomes: Sequence[Outcome]) -> int:
    """Write the page, say where it is, and return the exit code."""
    from slarm_graph.paper.figures import gallery_html

    failed = sum(outcome.status != "ok" for outcome in outcomes)
    lead = f"{len(outcomes)} {_LEAD.format(failed=failed)}"
    pictures = sorted(path.name for path in folder.path.glob("*.png"))
    page = gallery_html(folder.path, "The paper's figures, reproduced", lead, pictures, _TABLES)
    folder.write_text("report.html", page)
    folder.note(status="partial" if failed else "ok", runs=len(outcomes))
    print(f"{len(outcomes)} closed loops -> {folder.path}/report.html")
    return FAILED if failed else OK
