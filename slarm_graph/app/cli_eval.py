# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands `eval ...`: metrics of trajectories, relations, maps and radio maps in files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from slarm_graph.app import cli_eval_trajectory
from slarm_graph.app.options import Json, numbers
from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.geometry import Pose2
    from slarm_graph.grid import OccupancyGrid


def relations_command(
    relations: Annotated[Path, typer.Argument(metavar="FILE", help="True relative poses.")],
    estimate: Annotated[
        Path, typer.Argument(metavar="EST", help="Trajectory file, or a run folder.")
    ],
    at: Annotated[
        Literal["laser", "robot"],
        typer.Option(help="Frame whose relative poses FILE has."),
    ] = "laser",
    laser: Annotated[
        str | None,
        typer.Option(
            metavar="'X Y YAW'",
            help="Pose of the laser on the robot, in m and rad; default: as EST's run recorded it.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Errors of a trajectory's relative poses (Kuemmerle et al. 2009)."""
    from slarm_graph.app.cli_output import show_metrics
    from slarm_graph.eval.relations import read_relations, relation_errors, relation_metrics
    from slarm_graph.files.trajectories import read_trajectory, trajectory_file

    path = trajectory_file(estimate)
    truth, trajectory = read_relations(relations), read_trajectory(path)
    part = _laser_pose(laser, path) if at == "laser" else None
    errors = relation_errors(truth, trajectory, part)
    title = f"reference {relations}, estimate {path}"
    show_metrics(relation_metrics(errors), title=title, as_json=as_json)


def _laser_pose(given: str | None, trajectory: Path) -> Pose2:
    """Return `robot_from_laser` as given, as recorded by the run, or where the robot is."""
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.app.run_folder import recorded_laser
    from slarm_graph.geometry import Pose2

    if given is not None:
        return Pose2(*numbers(given, f"--laser {given}: expected three numbers X Y YAW", 3))
    recorded = recorded_laser(trajectory.parent)
    if recorded is not None:
        return recorded
    show_notices([f"no run.json beside {trajectory}: laser taken to be at the robot's origin"])
    return Pose2()


def map_command(
    reference: Annotated[
        Path, typer.Argument(metavar="REF", help="True map (YAML), or a run folder.")
    ],
    estimate: Annotated[
        Path, typer.Argument(metavar="EST", help="Map to evaluate, or a run folder.")
    ],
    align: Annotated[
        Literal["none", "se2"], typer.Option(help="Align EST to REF by their walls first.")
    ] = "none",
    tolerance: Annotated[
        float, typer.Option(help="Distance within which walls agree (precision, recall), in m.")
    ] = 0.1,
    difference: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a figure of the differences: PNG, PDF or SVG."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Cell accuracy, IoU, precision, recall and wall distance of an occupancy map."""
    from slarm_graph.app.cli_output import show_metrics
    from slarm_graph.eval.map_accuracy import map_accuracy, map_metrics
    from slarm_graph.eval.map_alignment import align_maps
    from slarm_graph.files.maps import read_map
    from slarm_graph.files.run_files import map_file

    ref, est = read_map(map_file(reference)), read_map(map_file(estimate))
    motion = align_maps(ref, est) if align == "se2" else None
    result = map_accuracy(ref, est, reference_from_estimate=motion, tolerance_m=tolerance)
    if difference is not None:
        _write_difference(difference, ref, est, motion)
    title = f"reference {reference}, estimate {estimate}"
    if motion is not None:
        title += f", aligned by ({motion.x:.3f} m, {motion.y:.3f} m, {motion.theta:.4f} rad)"
    show_metrics(map_metrics(result), title=title, as_json=as_json)


def _write_difference(
    path: Path, reference: OccupancyGrid, estimate: OccupancyGrid, motion: Pose2 | None
) -> None:
    from slarm_graph.eval.map_difference import save_difference

    with _writing(path):
        save_difference(path, reference, estimate, motion)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Raise BadInput when a figure's path cannot be written."""
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise BadInput(f"--difference {path}: a figure's name ends in .png, .pdf or .svg")
    try:
        yield
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror}") from None


def radio_command(
    reference: Annotated[
        str, typer.Argument(metavar="REF", help="True radio_map.npz, or a world (YAML or name).")
    ],
    estimate: Annotated[
        Path, typer.Argument(metavar="EST", help="Run folder, or a radio_map.npz.")
    ],
    tolerance: Annotated[float, typer.Option(help="Largest error of a right gain, in dB.")] = 1.0,
    difference: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a figure of EST minus REF: PNG, PDF or SVG."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Accuracy, coverage, gain hit rate and line-of-sight agreement of a radio map.

    With a measured_radio_map.npz or --difference, received levels are compared instead.
    """
    from slarm_graph.radio.levels import is_measured

    if difference is not None or is_measured(Path(reference)) or is_measured(estimate):
        _compare_levels(Path(reference), estimate, difference, as_json)
    else:
        _radio_accuracy(reference, estimate, tolerance, as_json)


def _compare_levels(reference: Path, estimate: Path, figure: Path | None, as_json: bool) -> None:
    from slarm_graph.app.cli_output import show_metrics
    from slarm_graph.eval.level_difference import level_difference, save_level_difference
    from slarm_graph.radio.levels import read_levels
    from slarm_graph.radio.references import names_world

    if names_world(str(reference)):
        raise BadInput(
            f"{reference}: levels are compared with a radio map, not with a world; give a"
            " radio_map.npz or a run folder, such as `slarm explore` makes in that world"
        )
    made = level_difference(read_levels(reference), read_levels(estimate))
    metrics = made.metrics()
    if figure is not None:
        with _writing(figure):
            save_level_difference(figure, made)
    title = f"levels, reference {reference}, estimate {estimate}"
    show_metrics(metrics, title=title, as_json=as_json)


def _radio_accuracy(reference: str, estimate: Path, tolerance: float, as_json: bool) -> None:
    from slarm_graph.app.cli_output import show_metrics, show_notices
    from slarm_graph.eval.radio_accuracy import radio_accuracy
    from slarm_graph.radio.references import (
        geographic_of,
        has_coverage,
        read_estimate,
        reference_for,
    )

    radio, folder = read_estimate(estimate)
    accessible, truth, extent_m = reference_for(reference, radio)
    result = radio_accuracy(
        accessible,
        truth,
        geographic_of(radio, folder),
        radio,
        tolerance_db=tolerance,
        extent_m=extent_m,
    )
    show_notices(result.warnings)
    metrics = result.metrics()
    if not has_coverage(folder):
        show_notices([f"no coverage.npz in {folder}: where there is a gain counts as accessible"])
        unknown = ("coverage_observed", "coverage_visited", "coverage_footprint")
        metrics = tuple(m for m in metrics if m.name not in unknown)
    show_metrics(metrics, title=f"reference {reference}, estimate {estimate}", as_json=as_json)


def metrics_command() -> None:
    """List every metric: unit, which way is better, where it applies, how it is computed."""
    from slarm_graph.app.cli_output import show_table
    from slarm_graph.eval.metric_table import kinds

    columns = ("key", "metric", "better", "where", "how")
    show_table(
        columns, [(k.name, k.titled(), k.better, k.applies, k.how) for k in kinds().values()]
    )


group = typer.Typer(
    help="Compute metrics of trajectories, maps and radio maps in files.", no_args_is_help=True
)
group.command("trajectory")(cli_eval_trajectory.trajectory_command)
group.command("relations")(relations_command)
group.command("map")(map_command)
group.command("radio")(radio_command)
group.command("metrics")(metrics_command)
group.command("consistency")(cli_eval_trajectory.consistency_command)
