# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled code is taken from where it is kept only if all it was made of is unchanged."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.kernels import content_of, kernel, kernel_with

CALLER = """
import sys, callee
from callee import LENGTH_M, TABLE, Pair, twice
from slarm_graph.kernels import kernel, kernel_with

@kernel
def result(x):
    pair = Pair(x, 1.0)
    return twice(pair.first) + LENGTH_M + TABLE[0] + callee.SHIFT

print(result(1.0), sum(result.stats.cache_hits.values()))
"""

CALLEE = """
from typing import NamedTuple
import numpy as np
from slarm_graph.kernels import kernel, kernel_with

LENGTH_M = 10.0
SHIFT = 1000.0
TABLE = np.array([100.0, 0.0])

class Pair(NamedTuple):
    first: float
    second: float

@kernel
def twice(x):
    return inner(x) * 2.0

@kernel
def inner(x):
    return x if x > 0.0 else -x
"""


DOUBLED = """
import sys
import numpy as np
from slarm_graph.kernels import kernel

@kernel
def doubled(values):
    return values * 2.0

@kernel
def total(values):
    return doubled(values).sum()

for name in sys.argv[1:]:
    print(np.sum(globals()[name](np.ones(3))))
"""


def output_of(folder: Path, *words: str, seed: str = "0") -> str:
    """What a program prints in a process of its own."""
    environment = {**os.environ, "PYTHONHASHSEED": seed, "NUMBA_CACHE_DIR": str(folder / "kept")}
    command = [sys.executable, *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


BUILT = """
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

def added(context, builder, signature, given):
    return builder.fadd(given[0], ir.Constant(ir.DoubleType(), 10.0))

@intrinsic
def more(typing, x):
    return types.float64(types.float64), added
"""


def run(folder: Path, seed: str = "0") -> tuple[float, int]:
    """Result of the caller in a process of its own, and whether it was taken from what is kept."""
    value, hits = output_of(folder, "caller.py", seed=seed).split()
    return float(value), int(hits)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "callee.py").write_text(CALLEE)
    return tmp_path


def test_what_is_unchanged_is_compiled_once(folder: Path) -> None:
    assert run(folder, "1") == (1112.0, 0)
    assert run(folder, "2") == (1112.0, 1)


def test_a_change_in_another_file_is_compiled_in(folder: Path) -> None:
    text = CALLEE
    run(folder)
    for old, new, expected in (
        ("* 2.0", "* 3.0", 1113.0),
        ("else -x", "else x", 1113.0),
        ("LENGTH_M = 10", "LENGTH_M = 20", 1123.0),
        ("[100.0", "[200.0", 1223.0),
        ("1000.0", "2000.0", 2223.0),
        ("first: float\n    second: float", "second: float\n    first: float", 2223.0),
        ("x if x > 0.0", "0.0 if x > 0.0", 2220.0),
    ):
        text = text.replace(old, new)
        (folder / "callee.py").write_text(text)
        assert run(folder) == (expected, 0), (old, new)


def test_code_of_two_processes_does_not_share_names(tmp_path: Path) -> None:
    """The second compiles again what the first compiled into a kernel that it loads."""
    (tmp_path / "own.py").write_text(DOUBLED)
    output_of(tmp_path, "own.py", "doubled", "total")
    for path in (tmp_path / "kept").rglob("*.doubled-*"):
        path.unlink()
    for _ in range(2):
        assert output_of(tmp_path, "own.py", "total", "doubled") == "6.0\n6.0\n"


def test_every_signature_has_a_file_of_its_own(folder: Path) -> None:
    """And what is out of date goes."""
    run(folder)
    call = "from caller import result; result(1)"
    output_of(folder, "-c", call)
    kept = set((folder / "kept").rglob("caller.result-*.nbc"))
    assert len(kept) == 2
    (folder / "callee.py").write_text(CALLEE.replace("* 2.0", "* 3.0"))
    run(folder)
    assert len(kept & set((folder / "kept").rglob("caller.result-*.nbc"))) == 1
    output_of(folder, "-c", call)
    assert not kept & set((folder / "kept").rglob("caller.result-*.nbc"))


def test_what_is_compiled_again_on_wish_is_not_taken_from_what_is_kept(folder: Path) -> None:
    run(folder)
    call = "from caller import result; result.recompile(); print(*result.stats.cache_hits.values())"
    assert output_of(folder, "-c", call).split()[-1] == "1"  # from importing it, before


def test_a_child_names_apart_from_its_parent() -> None:
    code = """
import os
from numba.core.bytecode import FunctionIdentity
from slarm_graph import kernels
if child := os.fork():
    os.waitpid(child, 0)
print(next(FunctionIdentity._unique_ids), flush=True)
"""
    first, second = map(int, output_of(Path.cwd(), "-c", code).split())
    assert abs(first - second) > 10**6


def test_how_a_callee_is_compiled_counts() -> None:
    def plain(x: float) -> float:
        return x * 2.0

    def caller_of(callee: object) -> str:
        values = {"callee": callee}
        exec("def caller(x):\n    return callee(x)", values)
        return content_of(values["caller"])

    fused = kernel_with(fastmath=frozenset({"contract"}))(plain)
    always = kernel_with(inline=True)(plain)
    assert len({caller_of(callee) for callee in (kernel(plain), fused, always)}) == 3
    assert caller_of(fused) == caller_of(kernel_with(fastmath=frozenset({"contract"}))(plain))


def test_what_builds_the_code_of_a_callee_counts(tmp_path: Path) -> None:
    """An intrinsic is no kernel, and what it calls is not looked into: its file counts."""
    told = []
    for number, text in enumerate((BUILT, BUILT, BUILT.replace("10.0", "20.0"))):
        file = tmp_path / f"built_{number}.py"
        file.write_text(text)
        values = runpy.run_path(str(file))
        exec("def caller(x):\n    return more(x)", values)
        told.append(content_of(values["caller"]))
    assert told[0] == told[1] != told[2]


def test_kernels_run_without_the_lock_and_as_python_does() -> None:
    @kernel
    def summed(values: np.ndarray) -> float:
        total = 0.0
        for value in values:
            total += value
        return total

    assert summed(np.arange(5.0)) == 10.0
    assert summed.targetoptions["nogil"]  # type: ignore[attr-defined]
