# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which test files belong to a file of the source: those that import it, then the next around."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SOURCES = ("slarm_graph", "frontends", "backends", "eval", "tests")
LEAST = 6
"""Test files of a file that fewer import are made up to so many with those of its importers, which
use it through them; with half as many some mutants survive that others of the suite kill."""
MOST = 12
"""A file that everything imports is tested by the most particular of them."""


def tests_of(tree: Path, changed: str) -> list[str]:
    """Test files of a source file, the nearest first.

    Parameters
    ----------
    tree : Path
    changed : str
        Path from the root of the tree.
    """
    importers, imports = _importers(tree)
    chosen: list[str] = []
    seen, ring = {changed}, [changed]
    while ring and len(chosen) < LEAST:
        around = {path for inner in ring for path in importers[inner]} - seen
        seen |= around
        tests = [path for path in around if path.startswith("tests/test_")]
        chosen += sorted(tests, key=lambda path: (imports[path], path))
        ring = sorted(around)
    return chosen[:MOST]


@cache
def _importers(tree: Path) -> tuple[dict[str, set[str]], dict[str, int]]:
    """Which files import a file, and how many files every file imports."""
    found: dict[str, set[str]] = defaultdict(set)
    count = {}
    for top in SOURCES:
        for path in (tree / top).rglob("*.py"):
            name = str(path.relative_to(tree))
            files = {_file_of(tree, module) for module in _imported(path)}
            count[name] = len(files)
            for file in files:
                found[file].add(name)
    return found, count


def _file_of(tree: Path, module: str) -> str:
    """File of a module or package; the rooms beside the core lie beside its folder."""
    parts = module.split(".")
    if parts[0] == "slarm_graph" and parts[1:2] and parts[1] in ("frontends", "backends", "eval"):
        parts = parts[1:]
    path = "/".join(parts)
    return f"{path}/__init__.py" if (tree / path).is_dir() else f"{path}.py"


def _imported(path: Path) -> Iterator[str]:
    """Yield all modules, and what is perhaps one, that a file imports or names as `a.b:C`."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and ":" in node.value:
            yield node.value.partition(":")[0]
