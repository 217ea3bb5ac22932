# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share, with their help texts and parsers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.access_points import AccessPoint
    from slarm_graph.config import RunConfig

POINT_OPTIONS = ("--ap",)
FARTHEST_M = 1e7
"""Limit of coordinates [m], those of UTM; squares of much larger ones would overflow."""

Backend = Annotated[
    str | None, typer.Option("--backend", "-b", help="SLAM backend; `slarm backends` lists them.")
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder in which the run folder is made.")]
Name = Annotated[
    str | None, typer.Option("--name", help="Name of the run folder; default: date and time.")
]
AccessPoints = Annotated[
    list[str] | None,
    typer.Option("--ap", metavar="X Y Z", help="Access point in the map frame, in m; repeatable."),
]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", "-c", help="YAML file of settings; `slarm config` prints them all."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="A setting: mapping.resolution_m=0.1; repeatable."
    ),
]
Odom = Annotated[
    str | None,
    typer.Option(
        "--odom", metavar="TOPIC|none", help="Odometry topic, or tf; none: use scans only."
    ),
]
Scan = Annotated[
    str | None, typer.Option("--scan", metavar="TOPIC", help="Topic of the laser scans to use.")
]
Segment = Annotated[
    int | None,
    typer.Option(help="Part to read of a recording whose clock jumps back, counted from 1."),
]
StaticTf = Annotated[
    list[str] | None,
    typer.Option(
        metavar="'PARENT CHILD X Y Z YAW'",
        help="Static transform that the recording lacks, in m and rad; repeatable.",
    ),
]
RosDistro = Annotated[
    str | None,
    typer.Option(
        "--ros-distro",
        metavar="NAME",
        help="ROS 2 release whose message definitions to use for a bag without any (before iron).",
    ),
]
GroundTruth = Annotated[
    Path | None,
    typer.Option(
        "--ground-truth",
        help="Ground-truth trajectory (TUM, EuRoC ...); default: SOURCE's name with .tum, if there;"
        " none: without.",
    ),
]
Resume = Annotated[
    Path | None, typer.Option("--resume", metavar="DIR", help="Continue an unfinished run.")
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace the results of an earlier run of that name.")
]
MaxTime = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Stop reading after this time; keep the results so far."),
]
MaxMemory = Annotated[
    float | None,
    typer.Option(
        metavar="MB", help="Stop before more memory than this is used; keep the results so far."
    ),
]
RelationsFile = Annotated[
    Path | None,
    typer.Option(
        "--relations",
        help="True relative poses (Freiburg benchmark); default: SOURCE's name with .relations, if"
        " there; none: without.",
    ),
]
Rss = Annotated[
    list[str] | None,
    typer.Option(
        "--rss",
        metavar="FILE|/TOPIC:FIELD[,NAME...]",
        help="Readings of signal strength: a CSV file (stamp, ap, rss_dbm; empty: not heard), a log"
        " of Bluetooth anchors, or a topic with its numeric field and the fields that name the"
        " access point; repeatable. Default: NAME_ble.txt beside NAME_scan.txt, and topics that"
        " certainly hold signal strength; none: without.",
    ),
]
Jobs = Annotated[
    int | None, typer.Option("--jobs", "-j", min=1, help="Number of parallel processes.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Recording = Annotated[list[Path], typer.Argument(metavar="SOURCE...", help="A recording.")]


def overriding(key: str, value: object) -> list[str]:
    """Return an option as `KEY=VALUE`, unless it is None; the value is JSON, which is YAML."""
    return [] if value is None else [f"{key}={json.dumps(value)}"]


def source_settings(
    odom: str | None, scan: str | None, segment: int | None, static_tf: list[str] | None
) -> list[str]:
    """Return the options that choose what to read of a recording as `KEY=VALUE`."""
    return [
        *overriding("source.odom", odom),
        *overriding("source.scan_topic", scan),
        *overriding("source.segment", segment),
        *overriding("source.static_tf", static_tf or None),
    ]


def limit_settings(max_time: float | None, max_memory: float | None) -> list[str]:
    """Return the options that end a run early as `KEY=VALUE`."""
    return [
        *overriding("limits.max_time_s", max_time),
        *overriding("limits.max_memory_mb", max_memory),
    ]


def source_config(
    odom: str | None,
    scan: str | None,
    segment: int | None,
    static_tf: list[str] | None,
    config: Path | None,
    settings: list[str] | None,
) -> RunConfig:
    """Return the configuration that options of `check` and `convert` make."""
    from slarm_graph.files.configs import load_config

    chosen = [*(settings or ()), *source_settings(odom, scan, segment, static_tf)]
    return load_config(config, chosen)


def numbers(text: str, otherwise: str, count: int | None = None) -> tuple[float, ...]:
    """Parse `count` numbers separated by blanks or commas; raise BadInput(otherwise) else."""
    try:
        found = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        raise BadInput(otherwise) from None
    if count is not None and len(found) != count:
        raise BadInput(otherwise)
    return found


def access_points(given: Sequence[str], config: RunConfig) -> tuple[AccessPoint, ...]:
    """Build access points AP1, AP2, ... from texts `X Y Z` [m]."""
    from slarm_graph.access_points import AccessPoint

    points = []
    for number, text in enumerate(given, start=1):
        x, y, z = numbers(text, f"--ap {text}: expected three numbers X Y Z [m]", 3)
        if not all(abs(value) <= FARTHEST_M for value in (x, y, z)) or z < 0.0:
            limit = f"X Y Z must be finite, within {FARTHEST_M * 1e-3:.0f} km"
            raise BadInput(f"--ap {text}: {limit}, and Z not below the floor [m]")
        radio = config.radio
        points.append(AccessPoint(f"AP{number}", x, y, z, radio.power_dbm, radio.frequency_hz))
    return tuple(points)
