# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a script does in one line: run a backend, match two scans, optimise a graph."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from slarm_graph import backends, parts
from slarm_graph.backend import Heartbeat, SlamResult, silent
from slarm_graph.config import RunConfig
from slarm_graph.constraint import MatchResult, PoseGraph
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading


def run_backend(
    readings: Iterable[Reading],
    backend: str | None = None,
    config: RunConfig | None = None,
    *,
    heartbeat: Heartbeat = silent,
) -> SlamResult:
    """Give a SLAM backend all readings, and return where the robot was.

    Parameters
    ----------
    readings : iterable of Reading
        In order of time, such as what `open_source` returns.
    backend : str, optional
        Instead of the one that the configuration names; `slarm backends` lists them.
    config : RunConfig, optional
    heartbeat : callable
        Told in words what a long step is doing.

    Returns
    -------
    SlamResult
        `map_from_robot` at every reading; `render` makes a map of it.

    Raises
    ------
    BadInput
        When there is no such backend, or it cannot use these readings.
    RunFailed
        When no reading was usable.
    """
    config = config or RunConfig()
    rng = np.random.default_rng(config.seed)
    slam = backends.make(backend or config.backend, config, rng, heartbeat)
    for reading in readings:
        slam.update(reading)
    return slam.result()


def match_scans(
    source: LaserScan | Floats,
    target: LaserScan | Floats,
    target_from_source: Pose2 | None = None,
    *,
    matcher: str = "correlative",
    config: RunConfig | None = None,
) -> MatchResult:
    """Lay one scan onto another.

    Parameters
    ----------
    source, target : LaserScan or (N, 2) float64
        Scans, or their returns in beam order, each in its own robot's frame [m].
    target_from_source : Pose2, optional
        First guess; none means that the robot has hardly moved [m, m, rad].
    matcher : str
        `slarm backends` lists them too.
    config : RunConfig, optional
        Has the settings of all matchers.

    Returns
    -------
    MatchResult
        Falsy with a reason when the scans do not fit.
    """
    config = config or RunConfig()
    made = parts.make("matcher", matcher, config, config.frontend.matching)
    points = (scan.points_m() if isinstance(scan, LaserScan) else scan for scan in (source, target))
    match: MatchResult = made.match(*points, target_from_source=target_from_source or Pose2())
    return match


def optimize_graph(graph: PoseGraph) -> PoseGraph:
    """Move a pose graph's poses to where its constraints fit best; pose 0 stays.

    GTSAM begins from the graph's own poses and from several other starts; the best counts.

    Raises
    ------
    RunFailed
        When the constraints do not determine the poses.
    """
    from slarm_graph.backends.pose_graph_optimizer import optimize_from_anywhere

    return replace(graph, poses=optimize_from_anywhere(graph).poses)
