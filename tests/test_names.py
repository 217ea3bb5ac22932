# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A class name means one thing in the whole package."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("slarm_graph", "frontends", "backends", "eval")


def modules() -> list[Path]:
    """All modules of the package, each by its real path."""
    return sorted({p.resolve() for room in ROOMS for p in (ROOT / room).rglob("*.py")})


def test_no_two_classes_share_a_name() -> None:
    homes: dict[str, list[str]] = defaultdict(list)
    for path in modules():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert len(homes) > 100, "modules are looked for in the wrong place"
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}
