# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command `radio`: a predicted or measured radio map over any map, and plans with it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from slarm_graph.app.options import (
    AccessPoints,
    ConfigFile,
    Name,
    Out,
    Overwrite,
    Settings,
    access_points,
    numbers,
)
from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from collections.abc import Sequence

    from slarm_graph.app.planning_radio import RadioOverMap
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.config import RunConfig
    from slarm_graph.radio.connectivity.candidate_sites import CandidateSite
    from slarm_graph.radio.connectivity.signal import SignalMap

MapFile = Annotated[
    Path, typer.Argument(metavar="MAP.yaml", help="A map_server map, or a run folder.")
]
RssFile = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FILE",
        help="Readings of signal strength: CSV (stamp, ap, rss_dbm; empty: not heard), or a log of"
        " Bluetooth anchors; repeatable.",
    ),
]
TrajectoryFile = Annotated[
    Path | None,
    typer.Option(
        "--trajectory", help="Trajectory in the map along which --rss was recorded, or its run."
    ),
]
Threshold = Annotated[
    float | None, typer.Option(help="Received level from which on a place is connected, in dBm.")
]
Begin = Annotated[
    str | None, typer.Option("--from", metavar="X,Y", help="Start of a path to plan, in m.")
]
End = Annotated[str | None, typer.Option("--to", metavar="X,Y", help="End of that path, in m.")]
LongestOutage = Annotated[
    float, typer.Option(help="Longest time without connection along the path, in s.")
]
OneMore = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="Z",
        help="Rank places on walls for another access point at height Z, in m.",
    ),
]
Point = tuple[float, float]
_SITES_SHOWN = 5
"""Printed lines of the ranking; the file has all."""


class _Plan(NamedTuple):
    """What to plan with a radio map: connected area, path, another access point."""

    threshold_dbm: float
    ends: tuple[Point, Point] | None
    longest_outage_s: float
    one_more_z_m: float | None

    @staticmethod
    def checked(
        threshold_dbm: float | None,
        ends: tuple[Point, Point] | None,
        longest_outage_s: float,
        one_more_z_m: float | None,
    ) -> _Plan | None:
        """Return the plan, None without a threshold; refuse options that would have no effect."""
        is_asked = threshold_dbm is not None
        _check_use(
            ("--from and --to", ends is not None, "--threshold", is_asked),
            ("--longest-outage", longest_outage_s > 0.0, "--from and --to", ends is not None),
            ("--one-more", one_more_z_m is not None, "--threshold", is_asked),
        )
        if threshold_dbm is None:
            return None
        return _Plan(threshold_dbm, ends, longest_outage_s, one_more_z_m)


def radio_command(
    map_file: MapFile,
    ap: AccessPoints = None,
    rss: RssFile = None,
    trajectory: TrajectoryFile = None,
    threshold: Threshold = None,
    begin: Begin = None,
    end: End = None,
    longest_outage: LongestOutage = 0.0,
    one_more: OneMore = None,
    fading: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Also draw N realisations of fading.")
    ] = None,
    outage: Annotated[
        float, typer.Option(metavar="DBM", help="With --fading: received power of an outage.")
    ] = -90.0,
    out: Out = Path("runs"),
    name: Name = None,
    config: ConfigFile = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
) -> None:
    """Predict or measure the radio map over any map_server map, and plan with it."""
    from slarm_graph.app.cli_output import show_notices
    from slarm_graph.app.planning_radio import radio_over_map
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.files.config_text import config_yaml
    from slarm_graph.files.configs import load_config

    resolved = load_config(config, settings or ())
    points = access_points(ap or (), resolved)
    _check_levels(threshold, outage, longest_outage)
    _check_use(("--trajectory", trajectory is not None, "--rss", bool(rss)))
    wanted = _Plan.checked(threshold, _ends(begin, end), longest_outage, one_more)
    made = radio_over_map(map_file, points, rss or (), trajectory, resolved)
    folder = create_run_folder(out, name, overwrite=overwrite)
    folder.write_text("config.yaml", config_yaml(resolved))
    made.save(folder)
    if fading is not None:
        print(made.save_fading(folder, fading, outage, resolved.seed))
    folder.note(status="ok", input={"paths": [str(map_file.resolve())]})
    show_notices(made.notices)
    print(f"{made.words} -> {folder.path}")
    if wanted is not None:
        _run_plan(made, wanted, resolved, folder)


def _run_plan(made: RadioOverMap, wanted: _Plan, config: RunConfig, folder: RunFolder) -> None:
    """Carry out the plan, write its results and print them."""
    from slarm_graph.app.planning_radio import plan_paths, save_sites

    level_dbm = wanted.threshold_dbm
    _print_connections(made.signal, level_dbm, folder)
    if wanted.one_more_z_m is not None:
        _print_sites(save_sites(made, wanted.one_more_z_m, level_dbm, config, folder))
    if wanted.ends is not None:
        outage_s = wanted.longest_outage_s
        for line in plan_paths(made.signal, wanted.ends, level_dbm, outage_s, config, folder):
            print(line)


def _check_levels(threshold_dbm: float | None, outage_dbm: float, longest_outage_s: float) -> None:
    for option, level in (("--threshold", threshold_dbm), ("--outage", outage_dbm)):
        if level is not None and not math.isfinite(level):
            raise BadInput(f"{option} {level:g}: a finite level [dBm], such as -75")
    if not longest_outage_s >= 0.0:
        raise BadInput(f"--longest-outage {longest_outage_s:g}: seconds, 0 or more")


def _check_use(*options: tuple[str, bool, str, bool]) -> None:
    """Refuse options given without another that they need: option, given, other, given."""
    for option, is_given, other, is_there in options:
        if is_given and not is_there:
            raise BadInput(f"{option} says nothing without {other}: give both, or neither")


def _ends(begin: str | None, end: str | None) -> tuple[Point, Point] | None:
    """Parse both ends of a path [m]; None when neither is given."""
    if begin is None and end is None:
        return None
    if begin is None or end is None:
        raise BadInput("a path needs both --from and --to")
    return _point(begin), _point(end)


def _point(text: str) -> Point:
    x, y = numbers(text, f"{text}: expected two numbers X,Y [m]", 2)
    if not (math.isfinite(x) and math.isfinite(y)):
        raise BadInput(f"{text}: X,Y must be finite [m]")
    return x, y


def _print_connections(signal: SignalMap, threshold_dbm: float, folder: RunFolder) -> None:
    """Print how far each access point reaches."""
    from slarm_graph.app.cli_output import show_table
    from slarm_graph.app.planning_radio import save_connections
    from slarm_graph.radio.connectivity.signal import PERCENTILES

    made = save_connections(signal, threshold_dbm, folder)
    levels = [f"{p:g} % [dBm]" for p in PERCENTILES]
    rows = [
        (
            one.name,
            f"{one.area_m2:.1f}",
            f"{one.share:.1%}",
            f"{one.largest_share:.1%}",
            f"{one.mean_outage:.1%}",
            *(f"{level:.1f}" for level in one.percentiles_dbm),
        )
        for one in made
    ]
    head = ("access point", "area [m²]", "connected", "in one patch", "mean outage", *levels)
    show_table(head, rows)


def _print_sites(sites: Sequence[CandidateSite]) -> None:
    """Print the best places for one more access point."""
    from slarm_graph.app.cli_output import show_table

    if not sites[0].gained_m2:
        print("one more access point on a wall connects no more floor")
        return
    rows = [
        (f"{p.x_m:.2f} {p.y_m:.2f} {p.z_m:g}", f"{p.gained_m2:.1f}", f"{p.share:.1%}")
        for p in sites[:_SITES_SHOWN]
    ]
    show_table(("one more at [m]", "gains [m²]", "connected then"), rows)
