# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Small changes of a source file: a comparison or sign turned round, a constant altered, ..."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_COMPARED = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
_TURNED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
_COMPUTED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change.

    Parameters
    ----------
    room, path : str
        The file, from the root of the tree.
    node : int
        Number of the node in the walk over the file.
    kind : str
    line : int
        Its own.
    source : str
    """

    room: str
    path: str
    node: int
    kind: str
    line: int
    source: str


def changes_of(node: ast.AST) -> Iterator[str]:
    """Yield the kinds of change that make sense for a node."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in _COMPARED:
        yield "boundary"
        if type(node.ops[0]) in _TURNED:
            yield "turned"
    elif isinstance(node, ast.BinOp) and type(node.op) in _COMPUTED:
        yield "operator"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Invert | ast.Not):
        yield "sign"
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield "constant"
    elif isinstance(node, ast.If | ast.IfExp):
        yield "condition"
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "call"
    elif isinstance(node, ast.AugAssign) and type(node.op) in _COMPUTED:
        yield "operator"


def apply(node: ast.AST, kind: str) -> None:
    """Change a node in place."""
    if isinstance(node, ast.Compare):
        table = _COMPARED if kind == "boundary" else _TURNED
        node.ops[0] = table[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp | ast.AugAssign):
        node.op = _COMPUTED[type(node.op)]()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else node.op
        if isinstance(node.op, ast.Invert | ast.Not):
            twice = ast.UnaryOp(type(node.op)(), node.operand)
            node.operand = ast.copy_location(twice, node)
    elif isinstance(node, ast.Constant):
        value = node.value
        node.value = (not value) if isinstance(value, bool) else value + 1 if value else 1
    elif isinstance(node, ast.If | ast.IfExp):
        node.test = ast.copy_location(ast.UnaryOp(ast.Not(), node.test), node.test)
    elif isinstance(node, ast.Expr):
        node.value = ast.copy_location(ast.Constant(None), node.value)


def mutants_in(room: str, path: Path, root: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file; annotations, types and decorators are left alone."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    tree = ast.parse(text)
    left_out = {id(inner) for part in _left_out(tree) for inner in ast.walk(part)}
    for number, node in enumerate(ast.walk(tree)):
        if id(node) not in left_out:
            for kind in changes_of(node):
                name, line = str(path.relative_to(root)), getattr(node, "lineno", 1)
                yield Mutant(room, name, number, kind, line, lines[line - 1].strip())


def _left_out(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield what says nothing of what the code does: annotations, and hints such as `slots`."""
    for node in ast.walk(tree):
        for part in ("annotation", "returns"):
            if getattr(node, part, None) is not None:
                yield getattr(node, part)
        yield from getattr(node, "decorator_list", ())


def mutated(text: str, mutant: Mutant) -> str:
    """Return the source of a file with the change in it."""
    tree = ast.parse(text)
    for number, node in enumerate(ast.walk(tree)):
        if number == mutant.node:
            apply(node, mutant.kind)
    return ast.unparse(ast.fix_missing_locations(tree))
