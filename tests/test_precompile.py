# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What was compiled ahead is not compiled again by the first run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


def slarm(kept: Path, *arguments: object) -> None:
    """Run the command in a process of its own that keeps what it compiles in a folder."""
    command = [sys.executable, "-m", "slarm_graph", *map(str, arguments)]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kept)}
    subprocess.run(command, env=environment, check=True, capture_output=True, cwd=kept)


@pytest.mark.slow
def test_a_first_run_finds_what_it_calls_compiled(tmp_path: Path) -> None:
    """By the number of kept functions: what a place new to it adds is a tenth at most."""
    kept = tmp_path / "kept"
    kept.mkdir()
    slarm(kept, "doctor", "--compile")
    ahead = len(list(kept.rglob("*.nbc")))
    assert ahead > 100
    slarm(kept, "run", "cluttered", "--out", tmp_path)
    assert len(list(kept.rglob("*.nbc"))) <= 1.1 * ahead
