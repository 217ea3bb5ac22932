# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiling ahead of the first run, as an image of a container or an installation wants it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from slarm_graph.app.execution import execute
from slarm_graph.app.job import Job
from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.config import RunConfig
from slarm_graph.files.worlds import load_world

_BACKENDS = ("pose_graph", "gmapping")
_WORLD = "paper_room"
"""Has closures, walls and shadows: all that a recording may call for."""


def compile_kernels() -> None:
    """Have everything compiled and kept that a run with a radio map calls, by running one."""
    access_points = load_world(_WORLD).access_points
    with tempfile.TemporaryDirectory() as out:
        for backend in _BACKENDS:
            job = Job((Path(_WORLD),), RunConfig(backend=backend), access_points)
            execute(job, create_run_folder(Path(out), backend), Quiet())
