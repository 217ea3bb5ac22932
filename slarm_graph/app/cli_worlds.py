# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command about worlds: those that come along, a template, and what is wrong with one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

TEMPLATE = """\
# A world: what stands where, how high, and where the access points hang. Lengths are in m, angles
# in deg. Check it:  slarm worlds --check FILE    Drive in it:  slarm explore --world FILE
name: my_world
# How high the ceiling is; nothing stands higher.
ceiling_m: 3.0
# Corners of the space, in order; the robot stays inside.
boundary_m: [[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0]]
# Where the robot starts.
start: {x_m: 1.0, y_m: 1.0, heading_deg: 0.0}
# Transmitters; power_dbm and frequency_hz may be left out.
access_points:
  - {name: AP1, x_m: 0.5, y_m: 4.5, z_m: 2.5, power_dbm: 20.0, frequency_hz: 3.5e+9}
# Walls along a line; `closed: true` leads back to its start. Or a hollow rectangle, by center_m and
# size_m (outside) and heading_deg in place of line_m.
walls:
  - {name: partition, line_m: [[4.0, 0.0], [4.0, 3.0]], thickness_m: 0.1, height_m: 3.0}
# Boxes, filled up to their height.
boxes:
  - {name: desk, center_m: [6.0, 1.5], size_m: [1.6, 0.8], heading_deg: 30.0, height_m: 0.75}
# Anything else, by its corners in order.
polygons:
  - {name: pillar, corners_m: [[2.0, 3.5], [2.4, 3.5], [2.2, 3.9]], height_m: 3.0}
"""


def worlds_command(
    template: Annotated[
        bool, typer.Option("--template", help="Print a world with comments, to be changed.")
    ] = False,
    check: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Tell all that is wrong with a world.")
    ] = None,
) -> None:
    """List the worlds that come along, print a template, or check one."""
    from slarm_graph.app.cli_output import show_table
    from slarm_graph.files.worlds import load_world, shipped_worlds, world_path

    if template:
        print(TEMPLATE, end="")
        return
    if check is not None:
        world = load_world(check)
        print(f"{check}: {_words(world)}")
        return
    rows = [(name, _words(load_world(name)), str(world_path(name))) for name in shipped_worlds()]
    show_table(("world", "what is in it", "file"), rows)


def _words(world: object) -> str:
    from slarm_graph.world import WorldMap

    assert isinstance(world, WorldMap)
    x_min, x_max, y_min, y_max = world.extent_m()
    count = len(world.access_points)
    points = f"{count} access point{'s' if count != 1 else ''}"
    return f"{x_max - x_min:g} x {y_max - y_min:g} m, {len(world.solids)} solids, {points}"
