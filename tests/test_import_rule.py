# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Imports go one way: core <- frontends <- backends; eval sees the core only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOW = {
    "pipeline",
    "execution",
    "job",
    "run_report",
    "compare",
    "trials",
    "doctor",
    "reproduce",
    "reproduce_trial",
    "exploration",
    "__main__",
}
"""Modules of the core folder that put the rooms together; the command line (`cli*`) is one too."""

MAY_IMPORT = {
    "core": {"core"},
    "frontends": {"core", "frontends"},
    "backends": {"core", "frontends", "backends"},
    "eval": {"core", "eval"},
    "flow": {"core", "frontends", "backends", "eval", "flow"},
}


def is_flow(stem: str) -> bool:
    return stem in FLOW or stem.startswith("cli")


def files() -> Iterator[tuple[str, Path]]:
    for path in (ROOT / "slarm_graph").glob("*.py"):
        yield "flow" if is_flow(path.stem) else "core", path
    for room in ("frontends", "backends", "eval"):
        for path in (ROOT / room).rglob("*.py"):
            yield room, path


def room_of(module: str) -> str | None:
    parts = module.split(".")
    if parts[0] != "slarm_graph":
        return None
    if len(parts) == 1:
        return "core"
    if parts[1] in ("frontends", "backends", "eval"):
        return parts[1]
    return "flow" if is_flow(parts[1]) else "core"


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
