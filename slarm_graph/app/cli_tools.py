# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands around the flow: check, convert, export, worlds, config, backends, doctor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from slarm_graph.app.options import (
    ConfigFile,
    Json,
    Odom,
    Recording,
    RosDistro,
    Scan,
    Segment,
    Settings,
    StaticTf,
    overriding,
    source_config,
)
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.world import WorldMap

Format = Literal["evo", "rpg", "mcap", "geojson"]
_ENDINGS = {"evo": ".evo.zip", "rpg": ".rpg", "mcap": ".mcap", "geojson": ".geojson"}
_TEMPLATE = Path(__file__).with_name("world_template.yaml")


def check_command(
    sources: Recording,
    as_json: Json = False,
    odom: Odom = None,
    scan: Scan = None,
    segment: Segment = None,
    static_tf: StaticTf = None,
    config: ConfigFile = None,
    settings: Settings = None,
) -> int:
    """Diagnose a recording before running it; exit code 1 for warnings, 2 when it is unusable."""
    from slarm_graph.frontends.recordings.check import check

    chosen = source_config(odom, scan, segment, static_tf, config, settings)
    diagnosis = check(sources, chosen.source, chosen.section)
    print(json.dumps(diagnosis.as_json(), indent=2) if as_json else diagnosis.text())
    return diagnosis.exit_code


def convert_command(
    sources: Recording,
    destination: Annotated[
        Path,
        typer.Argument(
            metavar="DEST",
            help="Output, in the format of its extension: .bag, .mcap, .db3, .clf or .log (also"
            " .gz); without one of these a ROS 2 bag folder.",
        ),
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace DEST.")] = False,
    odom: Odom = None,
    scan: Scan = None,
    segment: Segment = None,
    static_tf: StaticTf = None,
    ros_distro: RosDistro = None,
    compress: Annotated[
        bool, typer.Option("--compress", help="Compress: ROS 1 bags by lz4, ROS 2 bags by zstd.")
    ] = False,
    config: ConfigFile = None,
    settings: Settings = None,
) -> None:
    """Convert between ROS 1 bag, ROS 2 bag and CARMEN log."""
    from slarm_graph.frontends.recordings.convert import convert

    settings = [*(settings or ()), *overriding("source.ros_distro", ros_distro)]
    chosen = source_config(odom, scan, segment, static_tf, config, settings)
    summary = convert(
        sources,
        destination,
        chosen.source,
        overwrite=overwrite,
        compress=compress,
        section=chosen.section,
        simulation=chosen.simulation,
    )
    print(summary)


def export_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    form: Annotated[
        Format,
        typer.Option(
            "--as",
            help="evo: a result for evo_res; rpg: a folder for rpg_trajectory_evaluation; mcap: ROS"
            " 2 with path, maps, tf and radio map for Foxglove and RViz; geojson: walls and path.",
        ),
    ],
    target: Annotated[
        Path | None, typer.Option("--to", help="Output path; default: in RUN.")
    ] = None,
) -> None:
    """Write a run's results in a format for another tool."""
    from slarm_graph.app.export_mcap import write_results_mcap
    from slarm_graph.app.exports import write_evo, write_geojson, write_rpg

    if not run.is_dir():
        raise BadInput(f"{run}: not a run folder")
    place = target or run / f"results{_ENDINGS[form]}"
    writers = {"evo": write_evo, "rpg": write_rpg, "mcap": write_results_mcap,
               "geojson": write_geojson}  # fmt: skip
    try:
        writers[form](run, place)
    except OSError as error:
        raise BadInput(f"cannot write {place}: {error.strerror}") from None
    print(place)


def worlds_command(
    template: Annotated[
        bool, typer.Option("--template", help="Print a commented world file, to start from.")
    ] = False,
    check: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Report all errors of a world file.")
    ] = None,
) -> None:
    """List the worlds of this package, print a template, or check a world file."""
    from slarm_graph.app.cli_output import show_table
    from slarm_graph.files.worlds import load_world, shipped_worlds, world_path

    if template:
        print(_TEMPLATE.read_text(encoding="utf-8"), end="")
        return
    if check is not None:
        world = load_world(check)
        print(f"{check}: {_words(world)}")
        return
    rows = [(name, _words(load_world(name)), str(world_path(name))) for name in shipped_worlds()]
    show_table(("world", "what is in it", "file"), rows)


def _words(world: WorldMap) -> str:
    x_min, x_max, y_min, y_max = world.extent_m()
    points = count_of(len(world.access_points), "access point")
    solids = count_of(len(world.solids), "solid")
    return f"{x_max - x_min:g} x {y_max - y_min:g} m, {solids}, {points}"


def config_command(config: ConfigFile = None, settings: Settings = None) -> None:
    """Print all settings as YAML with explanations: defaults, changed by --config and --set."""
    from slarm_graph.files.config_text import config_yaml
    from slarm_graph.files.configs import load_config

    print(config_yaml(load_config(config, settings or ()), comments=True), end="")


def backends_command() -> None:
    """List the SLAM backends and all other exchangeable parts, and whether they can be used."""
    from slarm_graph import parts
    from slarm_graph.app.cli_output import show_table

    for kind in parts.KINDS:
        rows = [(s.name, s.problem or "ready", s.summary) for s in parts.statuses(kind)]
        if rows:
            show_table((kind, "status", "what it is"), rows)


def doctor_command(
    compile_ahead: Annotated[
        bool,
        typer.Option("--compile", help="Compile now what the first run would compile."),
    ] = False,
) -> int:
    """Test the installation: packages, gtsam, numba, pictures, writing to this folder."""
    from slarm_graph.app.cli_output import show_table
    from slarm_graph.app.doctor import examine

    if compile_ahead:
        from slarm_graph.app.precompile import compile_kernels

        print("Compiling; takes a minute or two ...")
        compile_kernels()
    findings = examine(Path.cwd())
    rows = [(f.name, "ok" if f.ok else "PROBLEM", f.detail) for f in findings]
    show_table(("what", "state", "detail"), rows)
    return 0 if all(finding.ok for finding in findings) else 1
