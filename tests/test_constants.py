# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Every number with a name says where it comes from, or what half and double of it do."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_names import ROOT, modules

BENCHMARKS = sorted((ROOT / "benchmarks").glob("*.py"))
FEWEST_WORDS = 4
"""A remark of fewer words explains nothing; the shortest that does has five."""


def _is_number(node: ast.expr) -> bool:
    """Whether an expression is made of numbers: literals, sums, tuples and calls of them."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) or _is_number(node.right)
    if isinstance(node, ast.Tuple | ast.List):
        return bool(node.elts) and all(map(_is_number, node.elts))
    if isinstance(node, ast.Call):
        return bool(node.args) and all(map(_is_number, node.args))
    return False


def constants(source: str) -> Iterator[tuple[str, bool]]:
    """Yield the names of a module's numeric constants, and whether each is explained.

    One explanation may serve several constants that stand on the lines right above it.
    """
    lines = source.splitlines()
    body = ast.parse(source).body
    for index, node in enumerate(body):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        if _is_number(node.value):
            yield ast.unparse(target), _is_explained(body, index, lines)


def _is_explained(body: list[ast.stmt], index: int, lines: list[str]) -> bool:
    node = body[index]
    above = lines[node.lineno - 2].strip()
    remarks = [above] if above.startswith("#") else []
    remarks += re.findall(r"#.*", lines[(node.end_lineno or node.lineno) - 1])
    after = body[index + 1] if index + 1 < len(body) else None
    if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
        remarks.append(str(after.value.value))
    return any(len(re.findall(r"[A-Za-z]+", remark)) >= FEWEST_WORDS for remark in remarks)


def test_what_counts_as_explained() -> None:
    source = (
        "A = 1\nB = 2.0\n'''Half and double change nothing at all.'''\n"
        "# From the standard, table 3.\nC = (1, 2)\nD: Final = round(0.1 / 0.2)\n'''Cells.'''\n"
        "E = -3  # A data sheet says so.\nF = 'text'\nG = [x for x in 'ab']\nH = True\n"
    )
    found = [("A", False), ("B", True), ("C", True), ("D", False), ("E", True)]
    assert list(constants(source)) == found


@pytest.mark.parametrize(
    "path", [*modules(), *BENCHMARKS], ids=lambda path: str(path.relative_to(ROOT))
)
def test_every_number_is_explained(path: Path) -> None:
    found = constants(path.read_text(encoding="utf-8"))
    assert [name for name, explained in found if not explained] == []
