# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Imports go one way: core <- frontends <- backends; eval sees the core; app puts all together."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

MAY_IMPORT = {
    "core": {"core"},
    "frontends": {"core", "frontends"},
    "backends": {"core", "frontends", "backends"},
    "eval": {"core", "eval"},
    "app": {"core", "frontends", "backends", "eval", "app", "paper"},
    "paper": {"core", "frontends", "backends", "eval", "app", "paper"},
}


def room_of(module: str) -> str | None:
    """Return the room of an imported module; None for those of others."""
    parts = module.split(".")
    if parts[0] != "slarm_graph":
        return None
    return parts[1] if len(parts) > 1 and parts[1] in MAY_IMPORT else "core"


def files() -> Iterator[tuple[str, Path]]:
    for room in ("frontends", "backends", "eval"):
        yield from ((room, path) for path in (ROOT / room).rglob("*.py"))
    for path in (ROOT / "slarm_graph").rglob("*.py"):
        inside = path.relative_to(ROOT / "slarm_graph").parts[0]
        if inside == "__main__.py":
            yield "app", path
        elif inside not in ("frontends", "backends", "eval"):
            yield inside if inside in ("app", "paper") else "core", path


def imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            if node.module == "slarm_graph":
                yield from (f"slarm_graph.{name.name}" for name in node.names)


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_imports_go_one_way(room: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {module}"
        for mine, path in files()
        if mine == room
        for module in imported(path)
        if (theirs := room_of(module)) is not None and theirs not in MAY_IMPORT[room]
    ]
    assert not wrong


def test_rooms_are_never_imported_by_their_bare_names() -> None:
    bare = {"frontends", "backends", "eval"}
    wrong = [path for _, path in files() for m in imported(path) if m.split(".")[0] in bare]
    assert not wrong


def test_gtsam_stays_in_the_pose_graph_backend() -> None:
    users = {path.name for _, path in files() if "gtsam" in set(imported(path))}
    assert all(name.startswith("pose_graph") for name in users)


def test_a_run_loads_what_it_uses() -> None:
    """Each of these takes 3 to 30 MB and has no part in a run without access points."""
    code = (
        "import sys; import slarm_graph.app.execution, slarm_graph.backends.pose_graph\n"
        "heavy = 'matplotlib.figure', 'netCDF4', 'scipy.optimize', 'scipy.stats', 'filterpy'\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
