# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command that judges anyone's trajectory by the recording it is of: eval consistency."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from slarm_graph.app.options import Json, Odom, Scan, source_config
from slarm_graph.errors import BadInput


def consistency_command(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE... TRAJECTORY", help="A recording, and a trajectory of it."),
    ],
    odom: Odom = None,
    scan: Scan = None,
    as_json: Json = False,
) -> None:
    """Does a trajectory contradict itself? Judged by its scans and odometry, without any truth."""
    from slarm_graph.app.cli_output import show_notices, show_table
    from slarm_graph.app.judging import judge_file
    from slarm_graph.files.consistency import CONFLICT_COLUMNS, conflict_rows, consistency_json

    if len(sources) < 2:
        raise BadInput("two files are needed: slarm eval consistency SOURCE TRAJECTORY")
    *recording, trajectory = sources
    chosen = source_config(odom, scan, None, None, None, None)
    result, notices = judge_file(recording, trajectory, chosen.source_as_used())
    show_notices(notices)
    if as_json:
        print(consistency_json(result), end="")
        return
    rows = [tuple(map(str, row)) for row in conflict_rows(result)]
    if rows:
        show_table(CONFLICT_COLUMNS, rows, title=f"conflicts of {trajectory}", right=range(1, 12))
    print(result.summary())
