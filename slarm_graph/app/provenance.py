# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Software of a run: versions of packages and the git revision of this code."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import slarm_graph

Facts = dict[str, object]

_VERSIONS = ("slarm-graph", "numpy", "scipy", "numba", "gtsam", "opencv-python-headless", "rosbags")


def versions() -> Facts:
    """Return the versions of Python and of packages that results depend on; None if missing."""
    found: Facts = {"python": sys.version.split()[0]}
    for name in _VERSIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


@cache
def git_revision() -> str | None:
    """Return the revision of the checkout this code runs from, marked when files differ."""
    here = Path(slarm_graph.__file__).resolve().parent
    if not (here.parent / ".git").exists():
        return None
    command = ["git", "-C", str(here), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None
