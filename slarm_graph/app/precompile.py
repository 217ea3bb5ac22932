# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Compilation of all kernels before the first run, for container images and installations."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from slarm_graph.app.execution import execute
from slarm_graph.app.job import Job
from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.config import RunConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.likelihood_grid import build_likelihood_grid
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.line_of_sight import line_of_sight_past_cells

_BACKENDS = ("pose_graph", "gmapping")
_WORLD = "paper_room"
"""Has loop closures, walls and shadowed cells, so that its runs call most kernels."""


def compile_kernels() -> None:
    """Compile and cache every kernel of a run with a radio map, by running each backend."""
    access_points = load_world(_WORLD).access_points
    with tempfile.TemporaryDirectory() as out:
        for backend in _BACKENDS:
            job = Job((Path(_WORLD),), RunConfig(backend=backend), access_points)
            execute(job, create_run_folder(Path(out), backend), Quiet())
    _compile_searches()
    _compile_sight_without_heights()


def _compile_searches() -> None:
    """Call the coarse-to-fine search, which only loop closures after a long path need."""
    wall = np.array([[-1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, -1.0]])
    grid = build_likelihood_grid(wall, resolution_m=0.1, sigma_m=0.3)
    points = np.array([[0.5, 1.0], [1.0, 0.5]])
    search(build_pyramid(grid), points, Pose2(), reach_m=0.3, reach_rad=0.1)


def _compile_sight_without_heights() -> None:
    """Call the line of sight past obstacles of unknown height, which only recordings need."""
    geometry = GridGeometry(0.0, 0.0, 1.0, 3, 3)
    line_of_sight_past_cells(geometry, np.eye(3, dtype=np.bool_), (0.5, 2.5, 2.0), 0.3)
