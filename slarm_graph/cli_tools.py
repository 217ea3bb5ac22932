# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands around the flow: radio, check, convert, config, backends, doctor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from slarm_graph.cli_run import ConfigFile, Settings


def add_to(app: typer.Typer) -> None:
    """Register the commands."""
    app.command("convert")(convert_command)
    app.command("config")(config_command)
    app.command("backends")(backends_command)
    app.command("doctor")(doctor_command)


def convert_command(
    sources: Annotated[list[Path], typer.Argument(metavar="SOURCE...", help="A recording.")],
    destination: Annotated[
        Path,
        typer.Argument(
            metavar="DEST",
            help="Its ending says into what: .bag, .mcap, .db3, .clf or .log (also .gz), any other"
            " name a ROS 2 folder.",
        ),
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace DEST.")] = False,
    config: ConfigFile = None,
    settings: Settings = None,
) -> None:
    """Convert between ROS 1 bag, ROS 2 bag and CARMEN log."""
    from slarm_graph.config_files import load_config
    from slarm_graph.frontends.convert import convert

    resolved = load_config(config, settings or ())
    print(convert(sources, destination, resolved.source, overwrite=overwrite))


def config_command(config: ConfigFile = None, settings: Settings = None) -> None:
    """Print the configuration as YAML, defaults and what is given, with explanations."""
    from slarm_graph.config_files import config_yaml, load_config

    print(config_yaml(load_config(config, settings or ()), comments=True), end="")


def backends_command() -> None:
    """List the SLAM backends and whether they can be used."""
    from slarm_graph import backends
    from slarm_graph.cli_output import show_table

    rows = [(s.name, s.problem or "ready", s.summary) for s in backends.statuses()]
    show_table(("backend", "status", "what it is"), rows)


def doctor_command() -> int:
    """Test the environment: versions, the parts that break, where results would go."""
    from slarm_graph.cli_output import show_table
    from slarm_graph.doctor import examine

    findings = examine(Path.cwd())
    rows = [(f.name, "ok" if f.ok else "PROBLEM", f.detail) for f in findings]
    show_table(("what", "state", "detail"), rows)
    return 0 if all(finding.ok for finding in findings) else 1
