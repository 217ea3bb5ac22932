# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert recordings between ROS 1 bags, ROS 2 bags and CARMEN logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slarm_graph.config import SimulationConfig, SourceConfig
from slarm_graph.counts import count_of
from slarm_graph.frontends.recordings.formats import Sections, format_of, format_written_as
from slarm_graph.frontends.recordings.ros_format import Ros, copy_messages
from slarm_graph.frontends.recordings.ros_writing import SIGNAL_OPTION, prepare_destination
from slarm_graph.frontends.recordings.sources import existing_paths, open_source
from slarm_graph.frontends.recordings.world_format import WorldFile


def convert(
    sources: Sequence[Path | str] | Path | str,
    destination: Path,
    config: SourceConfig | None = None,
    *,
    overwrite: bool = False,
    compress: bool = False,
    section: Sections | None = None,
    simulation: SimulationConfig | None = None,
) -> str:
    """Convert a recording to the format of the destination's extension.

    ROS to ROS keeps every topic, message by message. To and from CARMEN, and from a damaged
    recording, goes through readings: scans with the odometry at their stamps. A world file becomes
    the recording of a drive through it, with the true poses on /ground_truth.

    Parameters
    ----------
    sources : path or sequence of paths
    destination : Path
        `.bag` ROS 1; `.mcap`, `.db3` one ROS 2 file; `.clf`, `.log` (also `.gz`) CARMEN; any other
        name a ROS 2 folder.
    config : SourceConfig, optional
        Choice of topics, where the conversion goes through readings.
    overwrite : bool
    compress : bool
        Compress ROS bags; a CARMEN log is compressed when its name ends in `.gz`.
    section : callable, optional
        As for `open_source`.
    simulation : SimulationConfig, optional
        Of the robot that drives through a world.

    Returns
    -------
    str
        What was done, as one line.

    Raises
    ------
    BadInput
        When the source cannot be read or the destination exists.
    """
    paths, destination = existing_paths(sources), Path(destination)
    prepare_destination(destination, overwrite=overwrite)
    kind, target = format_of(paths, section), format_written_as(destination, section)
    besides = ""
    if isinstance(kind, Ros) and isinstance(target, Ros):
        distro = None if config is None else config.ros_distro
        loss = copy_messages(paths, destination, distro, compress=compress)
        if not loss:
            return f"{destination}: every message of {', '.join(path.name for path in paths)}"
        besides = f"; only scans and odometry, for {loss}"
    source = open_source(paths, config, simulation, section=section)
    count = target.write(destination, source)
    if compress and isinstance(target, Ros):
        copy_messages([destination], destination, compress=True)
    if isinstance(kind, WorldFile) and isinstance(target, Ros):
        besides = ", with ground truth"
        if simulation is not None and simulation.signals.rate_hz > 0.0:
            besides += f" and signal strengths (--rss {SIGNAL_OPTION})"
    return f"{destination}: {count_of(count, 'scan')} of {source.info().description}{besides}"
