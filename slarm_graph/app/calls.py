# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Functions for scripts: run a backend, match two scans, optimise a pose graph."""

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
    """Run a SLAM backend over readings and return the trajectory.

    Parameters
    ----------
    readings : iterable of Reading
        In order of time, such as `open_source` returns.
    backend : str, optional
        Overrides `config.backend`; `slarm backends` lists them.
    config : RunConfig, optional
    heartbeat : callable
        Called with a message about what a long step is doing.

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
    """Match a scan (source) to another (target).

    Parameters
    ----------
    source, target : LaserScan or (N, 2) float64
        Scans, or their returns in beam order, each in its own robot's frame [m].
    target_from_source : Pose2, optional
        Initial guess [m, m, rad]; default: identity.
    matcher : str
        Name of the matcher; `slarm backends` lists them, too.
    config : RunConfig, optional
        Has the settings of all matchers.

    Returns
    -------
    MatchResult
        Falsy with a reason when the match failed.
    """
    config = config or RunConfig()
    made = parts.make("matcher", matcher, config, config.frontend.matching)
    points = (scan.points_m() if isinstance(scan, LaserScan) else scan for scan in (source, target))
    match: MatchResult = made.match(*points, target_from_source=target_from_source or Pose2())
    return match


def optimize_graph(graph: PoseGraph) -> PoseGraph:
    """Optimise the poses of a pose graph with GTSAM; pose 0 stays fixed.

    The initial values are the graph's own poses and several others; the best result counts.

    Raises
    ------
    RunFailed
        When the constraints do not determine the poses.
    """
    from slarm_graph.backends.pose_graph_optimizer import optimize_from_anywhere

    return replace(graph, poses=optimize_from_anywhere(graph).poses)
