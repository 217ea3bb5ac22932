# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A self-test of the installation: packages, compiled code, writing of results."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from slarm_graph.counts import count_of

_PACKAGES = ("numpy", "scipy", "numba", "gtsam", "opencv-python-headless", "rosbags", "matplotlib")
_OPTIONAL = ("mujoco", "sionna-rt")


@dataclass(frozen=True, slots=True)
class SelfCheck:
    """The result of one check.

    Parameters
    ----------
    name : str
    ok : bool
    detail : str
        What was found, or what to do about it.
    """

    name: str
    ok: bool
    detail: str


def examine(folder: Path) -> tuple[SelfCheck, ...]:
    """Check Python, packages, compiled code, and whether results can be written to a folder."""
    return (
        SelfCheck("python", sys.version_info >= (3, 11), sys.version.split()[0]),
        *(_package(name, needed=True) for name in _PACKAGES),
        *(_package(name, needed=False) for name in _OPTIONAL),
        _try("gtsam with this numpy", _optimise),
        _try("numba compiles", _compile),
        _try("pictures without a screen", _draw),
        _try(f"writing to {folder}", lambda: _write(folder)),
    )


def _package(name: str, *, needed: bool) -> SelfCheck:
    try:
        return SelfCheck(name, True, version(name))
    except PackageNotFoundError:
        missing = f"not installed: pip install '{name}'"
        return SelfCheck(name, not needed, missing if needed else "not installed (optional)")


def _try(name: str, attempt: Callable[[], str]) -> SelfCheck:
    try:
        return SelfCheck(name, True, attempt())
    except Exception as error:
        return SelfCheck(name, False, f"{type(error).__name__}: {error}")


def _optimise() -> str:
    import numpy as np

    from slarm_graph import backends
    from slarm_graph.config import RunConfig

    backends.make("pose_graph", RunConfig(), np.random.default_rng(0), lambda _message: None)
    return "the pose-graph backend can be built"


def _compile() -> str:
    import numpy as np

    from slarm_graph.config import MappingConfig
    from slarm_graph.mapping import render
    from slarm_graph.readings import LaserScan
    from slarm_graph.trajectory import Trajectory

    scan = LaserScan(np.ones(8), 0.0, 0.5, 0.1, 5.0)
    grid = render([scan], Trajectory(np.array([0]), np.zeros((1, 3))), MappingConfig())
    return f"{count_of(int(grid.occupied.sum()), 'wall cell')} seen in a test scan"


def _draw() -> str:
    from matplotlib.figure import Figure

    with tempfile.TemporaryFile() as file:
        Figure().savefig(file, format="png")
    return "drawn with matplotlib"


def _write(folder: Path) -> str:
    with tempfile.TemporaryDirectory(dir=folder) as name:
        (Path(name) / "link").symlink_to("target")
    return "files and links"
