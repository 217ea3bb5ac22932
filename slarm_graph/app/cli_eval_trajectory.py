# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands `eval trajectory` (against ground truth) and `eval consistency` (without)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from slarm_graph.app.options import Json, Odom, Scan, numbers, source_config
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.eval.evaluation import Evaluation, EvaluationOptions
    from slarm_graph.eval.trajectory_plots import BackgroundMap

Reference = Annotated[Path, typer.Argument(metavar="REF", help="True trajectory, or a run folder.")]
Estimates = Annotated[
    list[Path], typer.Argument(metavar="EST...", help="Trajectories to evaluate, or run folders.")
]
Align = Annotated[
    Literal["se2", "sim2", "se3", "sim3", "yaw", "origin", "none"],
    typer.Option(
        help="How EST is aligned to REF: in the plane of motion (se2, sim2, origin, none) or in"
        " space (se3, sim3, yaw and position)."
    ),
]
NToAlign = Annotated[
    int | None, typer.Option(help="Align by this many pairs from the beginning only.")
]
Assoc = Annotated[
    Literal["interpolate", "nearest", "evo"],
    typer.Option(help="Pair poses by interpolating the denser file, or the nearest as evo does."),
]
MaxDifference = Annotated[
    float, typer.Option(help="Largest time difference of nearest poses, in s.")
]
TimeOffset = Annotated[
    str, typer.Option(metavar="SECONDS|auto", help="Added to the stamps of EST; auto: estimated.")
]
Delta = Annotated[float, typer.Option(help="Step over which the RPE is taken.")]
DeltaUnit = Annotated[Literal["frames", "m", "s"], typer.Option(help="Unit of --delta.")]
Lengths = Annotated[
    str | None,
    typer.Option(
        metavar="A,B",
        help="Path lengths for the drift, in m; default: a tenth to a half of the path.",
    ),
]
Plot = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Write figures into this folder: PNG, PDF, SVG.")
]
MapFile = Annotated[
    Path | None,
    typer.Option("--map", metavar="YAML", help="Map to draw below the paths, in REF's frame."),
]


def trajectory_command(
    reference: Reference,
    estimates: Estimates,
    align: Align = "se2",
    n_to_align: NToAlign = None,
    assoc: Assoc = "interpolate",
    t_max_diff: MaxDifference = 0.01,
    t_offset: TimeOffset = "0",
    delta: Delta = 1.0,
    delta_unit: DeltaUnit = "frames",
    lengths: Lengths = None,
    plot: Plot = None,
    map_file: MapFile = None,
    as_json: Json = False,
) -> None:
    """ATE, RPE, drift and scale of trajectories: TUM, KITTI, EuRoC, tables with named columns."""
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.eval.alignment import AlignmentMethod
    from slarm_graph.eval.association import AssociationMethod
    from slarm_graph.eval.evaluation import EvaluationOptions

    options = EvaluationOptions(
        AlignmentMethod(align),
        n_to_align,
        AssociationMethod("nearest" if assoc == "evo" else assoc),
        t_max_diff,
        None if t_offset == "auto" else _seconds(t_offset),
        delta,
        delta_unit,
        numbers(lengths, f"--lengths {lengths}: expected numbers") if lengths else (),
    )
    files, evaluations = _evaluate_all(reference, estimates, options)
    for name, found in evaluations.items():
        prefix = f"{name}: " if len(evaluations) > 1 else ""
        show_notices(prefix + notice for notice in found.notices)
    _show(evaluations, f"against {reference.resolve().name}", as_json)
    if plot is not None:
        _plot(plot, evaluations, _background_map(map_file, files, evaluations))


def _seconds(t_offset: str) -> float:
    return numbers(t_offset, f"--t-offset {t_offset}: expected a number", 1)[0]


def _evaluate_all(
    reference: Path, estimates: Sequence[Path], options: EvaluationOptions
) -> tuple[dict[str, Path], dict[str, Evaluation]]:
    """Return the files of all estimates and their evaluations, by the estimate's name."""
    from slarm_graph.eval.evaluation import evaluate
    from slarm_graph.files.trajectories import read_spatial, trajectory_file

    truth = read_spatial(trajectory_file(reference, truth=True))
    files = dict(zip(_names(estimates), map(trajectory_file, estimates), strict=True))
    return files, {
        name: evaluate(truth, read_spatial(path), options) for name, path in files.items()
    }


def _names(paths: Sequence[Path]) -> list[str]:
    """Return a unique name of each path: its last part, or the whole path where needed."""
    short = [path.resolve().name for path in paths]
    return short if len(set(short)) == len(short) else [str(path) for path in paths]


def _show(evaluations: Mapping[str, Evaluation], against: str, as_json: bool) -> None:
    from slarm_graph.app.cli_output import show_metrics, show_metrics_of_many
    from slarm_graph.eval.metrics import metrics_json

    if len(evaluations) == 1:
        ((name, found),) = evaluations.items()
        show_metrics(
            found.metrics, title=f"{name} {against}, {found.alignment.note}", as_json=as_json
        )
    elif as_json:
        content = {name: json.loads(metrics_json(e.metrics)) for name, e in evaluations.items()}
        print(json.dumps(content, indent=2))
    else:
        show_metrics_of_many({name: e.metrics for name, e in evaluations.items()}, title=against)


def _background_map(
    given: Path | None, files: Mapping[str, Path], evaluations: Mapping[str, Evaluation]
) -> BackgroundMap | None:
    """Return the map to draw: the one given, or that of the first estimate's run folder."""
    import numpy as np

    from slarm_graph.eval.alignment import Alignment
    from slarm_graph.files.maps import read_map

    if given is not None:
        return read_map(given), Alignment(np.eye(2), np.zeros(2), 1.0, "")
    for name, path in files.items():
        beside = path.with_name("map.yaml")
        if path.name == "trajectory.tum" and beside.is_file():
            return read_map(beside), evaluations[name].alignment
    return None


def _plot(folder: Path, evaluations: Mapping[str, Evaluation], below: BackgroundMap | None) -> None:
    from slarm_graph.eval.trajectory_plots import save_plots

    try:
        written = save_plots(folder, evaluations, below)
    except OSError as error:
        raise BadInput(f"--plot {folder}: cannot be written ({error.strerror})") from None
    import sys

    print(f"{count_of(len(written), 'figure')} in {folder}", file=sys.stderr)


def consistency_command(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE... TRAJECTORY", help="Recording, and its trajectory."),
    ],
    odom: Odom = None,
    scan: Scan = None,
    as_json: Json = False,
) -> None:
    """Check a trajectory against its scans and odometry, without ground truth."""
    from slarm_graph.app.cli_output import show_notices, show_table
    from slarm_graph.app.consistency_check import check_trajectory_file
    from slarm_graph.files.consistency import CONFLICT_COLUMNS, conflict_rows, consistency_json

    if len(sources) < 2:
        raise BadInput("two files are needed: slarm eval consistency SOURCE TRAJECTORY")
    *recording, trajectory = sources
    chosen = source_config(odom, scan, None, None, None, None)
    result, notices = check_trajectory_file(recording, trajectory, chosen.source_as_used())
    show_notices(notices)
    if as_json:
        print(consistency_json(result), end="")
        return
    rows = [tuple(map(str, row)) for row in conflict_rows(result)]
    if rows:
        show_table(CONFLICT_COLUMNS, rows, title=f"conflicts of {trajectory}", right=range(1, 12))
    print(result.summary())
