# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands around the flow: radio, check, convert, config, backends, doctor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from slarm_graph.app.cli_run import (
    AccessPoints,
    ConfigFile,
    Name,
    Odom,
    Out,
    Overwrite,
    Scan,
    Segment,
    Settings,
    StaticTf,
    access_points,
    source_config,
)
from slarm_graph.errors import BadInput


def radio_command(
    map_file: Annotated[Path, typer.Argument(metavar="MAP.yaml", help="A map_server map.")],
    ap: AccessPoints = None,
    out: Out = Path("runs"),
    name: Name = None,
    fading: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Also draw N realisations: fading.npz.")
    ] = None,
    outage: Annotated[
        float, typer.Option(metavar="DBM", help="A link is out below this received power.")
    ] = -90.0,
    config: ConfigFile = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
) -> None:
    """Make the radio map over any map_server map, taken as it is."""
    import numpy as np

    from slarm_graph.app.outputs import save_radio
    from slarm_graph.app.run_folder import create_run_folder
    from slarm_graph.files.config_text import config_yaml
    from slarm_graph.files.configs import load_config
    from slarm_graph.files.maps import read_map
    from slarm_graph.geographic import as_geographic
    from slarm_graph.radio.fading import fading_maps, write_fading
    from slarm_graph.radio.propagation.over_map import predicted_radio_map

    resolved = load_config(config, settings or ())
    points = access_points(ap or (), resolved)
    geographic = as_geographic(read_map(map_file), resolved.recovery.default_height_m)
    if not geographic.accessible.any():
        raise BadInput(f"{map_file}: no cell of the map is free; is `negate` or a threshold wrong?")
    radio = predicted_radio_map(geographic, points, resolved)
    folder = create_run_folder(out, name, overwrite=overwrite)
    folder.write_text("config.yaml", config_yaml(resolved))
    save_radio(folder, radio, resolved.radio)
    if fading is not None:
        rng = np.random.default_rng(resolved.seed)
        maps = fading_maps(radio, fading, rng, threshold_dbm=outage)
        with folder.replacing("fading.npz") as temporary:
            write_fading(temporary, maps)
        mean = float(np.nanmean(maps.outage_probability))
        print(f"{fading} realisations: {mean:.2%} of the links below {outage:g} dBm -> fading.npz")
    folder.note(status="ok", input={"paths": [str(map_file.resolve())]})
    low, high = radio.gain_span_db()
    print(
        f"{', '.join(ap.name for ap in points)}: expected gain {low:.1f} to {high:.1f} dB"
        f" -> {folder.path}/radio_map.png"
    )


def check_command(
    sources: Annotated[list[Path], typer.Argument(metavar="SOURCE...", help="A recording.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
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
    odom: Odom = None,
    scan: Scan = None,
    segment: Segment = None,
    static_tf: StaticTf = None,
    config: ConfigFile = None,
    settings: Settings = None,
) -> None:
    """Convert between ROS 1 bag, ROS 2 bag and CARMEN log."""
    from slarm_graph.frontends.recordings.convert import convert

    chosen = source_config(odom, scan, segment, static_tf, config, settings)
    print(convert(sources, destination, chosen.source, overwrite=overwrite, section=chosen.section))


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
