# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands around the flow: check, convert, config, backends, doctor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

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
            help="Its ending says into what: .bag, .mcap, .db3, .clf or .log (also .gz), any other"
            " name a ROS 2 folder.",
        ),
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace DEST.")] = False,
    odom: Odom = None,
    scan: Scan = None,
    segment: Segment = None,
    static_tf: StaticTf = None,
    ros_distro: RosDistro = None,
    compress: Annotated[
        bool, typer.Option("--compress", help="ROS 1 bags by lz4, ROS 2 bags by zstd.")
    ] = False,
    config: ConfigFile = None,
    settings: Settings = None,
) -> None:
    """Convert between ROS 1 bag, ROS 2 bag and CARMEN log."""
    from slarm_graph.frontends.recordings.convert import convert

    settings = [*(settings or ()), *overriding("source.ros_distro", ros_distro)]
    chosen = source_config(odom, scan, segment, static_tf, config, settings)
    told = convert(
        sources,
        destination,
        chosen.source,
        overwrite=overwrite,
        compress=compress,
        section=chosen.section,
        simulation=chosen.simulation,
    )
    print(told)


def config_command(config: ConfigFile = None, settings: Settings = None) -> None:
    """Print the configuration as YAML, defaults and what is given, with explanations."""
    from slarm_graph.files.config_text import config_yaml
    from slarm_graph.files.configs import load_config

    print(config_yaml(load_config(config, settings or ()), comments=True), end="")


def backends_command() -> None:
    """List the SLAM backends and all other parts, and whether they can be used."""
    from slarm_graph import parts
    from slarm_graph.app.cli_output import show_table

    for kind in parts.KINDS:
        rows = [(s.name, s.problem or "ready", s.summary) for s in parts.statuses(kind)]
        if rows:
            show_table((kind, "status", "what it is"), rows)


def doctor_command() -> int:
    """Test the environment: versions, the parts that break, where results would go."""
    from slarm_graph.app.cli_output import show_table
    from slarm_graph.app.doctor import examine

    findings = examine(Path.cwd())
    rows = [(f.name, "ok" if f.ok else "PROBLEM", f.detail) for f in findings]
    show_table(("what", "state", "detail"), rows)
    return 0 if all(finding.ok for finding in findings) else 1
