# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a stage frees goes back to the system, and nothing that is used is lost with it."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only done on Linux")

_PROGRAM = """
import re
import numpy as np
from slarm_graph.app.allocation import _held_by_files, return_freed
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.small_pose import between3

def files_mb():
    return int(re.search(r"RssFile:\\s+(\\d+)", open("/proc/self/status").read()).group(1)) / 1024

matrix = np.diag([1.0, 2.0, 4.0])
invert3(matrix)
before_mb = files_mb()
for _ in range(2):
    return_freed()
print(before_mb, files_mb())
# Code loaded before, and code loaded now; both need the library that was given back.
assert np.allclose(invert3(matrix), np.linalg.inv(matrix))
assert np.allclose(between3(np.zeros(3), np.array([1.0, 2.0, 0.0])), [1.0, 2.0, 0.0])
ranges = dict(_held_by_files())
for line in open("/proc/self/maps"):
    edges, rights, *rest = line.split()
    first, past = (int(edge, 16) for edge in edges.split("-"))
    if ranges.get(first) == past - first:
        assert "w" not in rights and ".so" in rest[-1], line
"""


def test_libraries_that_have_done_their_work_are_not_kept_in_memory() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=False
    )
    assert not done.returncode, done.stderr
    before_mb, after_mb = map(float, done.stdout.split())
    assert after_mb < 0.3 * before_mb


def test_modules_are_not_gone_over_again_for_cycles() -> None:
    """But what is made afterwards is, and a cycle of it is found."""
    code = (
        "import gc, weakref, numba;"
        "from slarm_graph.app.allocation import freeze_garbage_collector;"
        "freeze_garbage_collector(); print(len(gc.get_objects()));"
        "cycle = type('Cycle', (), {})(); cycle.own = cycle; seen = weakref.ref(cycle); del cycle;"
        "gc.collect(); print(seen())"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    count, seen = said.stdout.split()
    assert int(count) < 1000
    assert seen == "None"


def test_numba_does_not_colour_what_it_tries_on() -> None:
    code = (
        "import sys; import slarm_graph.app.cli as cli; assert 'numba' not in sys.modules;"
        "cli.disable_error_highlighting(); from numba.core.errors import termcolor;"
        "print(type(termcolor()).__name__)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "NOPColorScheme"
