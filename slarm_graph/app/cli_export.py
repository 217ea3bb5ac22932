# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command that hands a run's results to other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from slarm_graph.errors import BadInput

Format = Literal["evo", "rpg", "mcap", "geojson"]
_ENDINGS = {"evo": ".evo.zip", "rpg": ".rpg", "mcap": ".mcap", "geojson": ".geojson"}


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
        Path | None, typer.Option("--to", help="Where to; else in the run folder.")
    ] = None,
) -> None:
    """Write a run's results as another tool opens them."""
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
