# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Mutation run: break the code in small ways and count how often a related test notices.

    python benchmarks/mutants.py [--per-room 20] [--seed 0] [--rooms radio,recovery,...]

A mutant is one change in the source: a comparison or sign turned round, a constant altered, a
boundary off by one, a condition negated, a call's result dropped. Mutants are drawn by chance, as
many per room; each is tested by the test files that belong to its room, in a copy of the tree, and
counts as killed when one of them fails or takes ten times as long as it should. Prints the
survivors and writes `mutants.csv`.
"""

from __future__ import annotations

import argparse
import ast
import copy
import csv
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

ROOMS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "backends": (
        ("backends",),
        (
            "proposal",
            "particle_filter",
            "motion_model",
            "gmapping",
            "rbpf",
            "pose_graph",
            "pose_graph_optimizer",
            "particle_maps",
        ),
    ),
    "scans": (
        ("frontends/scans",),
        (
            "tracker",
            "matchers",
            "scan_matching",
            "loop_closure",
            "odometry_filter",
            "wall_sides",
            "scan_filter",
        ),
    ),
    "radio": (
        ("slarm_graph/radio",),
        ("radio", "path_loss", "line_of_sight", "radio_files", "height_prior", "propagation"),
    ),
    "recovery": (
        ("slarm_graph/recovery",),
        ("recovery", "known_sizes", "height_prior", "reference"),
    ),
    "exploration": (
        ("slarm_graph/exploration",),
        ("ggmr", "planning", "lanes", "frontier", "closed_loop"),
    ),
    "eval": (
        ("eval",),
        (
            "trajectory_accuracy",
            "map_accuracy",
            "radio_accuracy",
            "relations",
            "reference",
            "compare",
            "report",
        ),
    ),
    "files": (
        ("slarm_graph/files",),
        ("map_files", "g2o", "trajectory_files", "world_files", "config_files", "radio_files"),
    ),
}
"""Folders of every room, and the tests that belong to it (tests/test_<name>.py)."""

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
    """One change: the node's number in the walk over its file, and what to do with it."""

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


def mutants_in(room: str, path: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file; annotations and names of types are left alone."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    tree = ast.parse(text)
    typed = {
        id(inner)
        for node in ast.walk(tree)
        for part in (getattr(node, "annotation", None), getattr(node, "returns", None))
        if part is not None
        for inner in ast.walk(part)
    }
    for number, node in enumerate(ast.walk(tree)):
        if id(node) not in typed:
            for kind in changes_of(node):
                line = getattr(node, "lineno", 0)
                name = str(path.relative_to(ROOT))
                yield Mutant(room, name, number, kind, line, lines[line - 1].strip())


def mutated(mutant: Mutant) -> str:
    """Return the source of a file with the change in it."""
    tree = copy.deepcopy(ast.parse((ROOT / mutant.path).read_text(encoding="utf-8")))
    for number, node in enumerate(ast.walk(tree)):
        if number == mutant.node:
            apply(node, mutant.kind)
    return ast.unparse(ast.fix_missing_locations(tree))


def passes(tree: Path, tests: list[str], limit_s: float) -> bool:
    """Whether all tests pass in a copy of the tree, in time."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:benchmark", *tests]
    command += ["-p", "no:cacheprovider", "-p", "no:randomly"]
    env = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / ".numba")}
    try:
        done = subprocess.run(
            command, cwd=tree, env=env, capture_output=True, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def run_room(room: str, count: int, seed: int) -> list[tuple[Mutant, bool]]:
    """Draw mutants of a room and return each with whether it was killed."""
    folders, names = ROOMS[room]
    files = sorted(p for folder in folders for p in (ROOT / folder).rglob("*.py"))
    every = [mutant for path in files for mutant in mutants_in(room, path)]
    chosen = random.Random(seed).sample(every, min(count, len(every)))
    tests = [f"tests/test_{n}.py" for n in names if (ROOT / f"tests/test_{n}.py").is_file()]
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        tree = Path(scratch) / "tree"
        ignore = shutil.ignore_patterns(".git", ".venv", "__pycache__", "runs", ".*cache")
        shutil.copytree(ROOT, tree, symlinks=True, ignore=ignore)
        began = time.monotonic()
        if not passes(tree, tests, 3600.0):
            raise SystemExit(f"{room}: its tests fail without any mutant")
        limit_s = 10.0 * (time.monotonic() - began) + 60.0
        for mutant in chosen:
            original = (tree / mutant.path).read_text(encoding="utf-8")
            (tree / mutant.path).write_text(mutated(mutant), encoding="utf-8")
            killed = not passes(tree, tests, limit_s)
            (tree / mutant.path).write_text(original, encoding="utf-8")
            found.append((mutant, killed))
            word = "killed" if killed else "SURVIVED"
            place = f"{mutant.path}:{mutant.line}"
            print(f"{word:8} {mutant.kind:9} {place}: {mutant.source}", flush=True)
    return found


def main() -> int:
    """Run, print the score per room, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--per-room", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--out", type=Path, default=Path("mutants.csv"))
    options = parser.parse_args()
    results = []
    for room in options.rooms.split(","):
        mine = run_room(room, options.per_room, options.seed)
        results += mine
        print(f"{room}: {sum(killed for _, killed in mine)} of {len(mine)} killed", flush=True)
    with options.out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("room", "file", "line", "kind", "killed", "source"))
        for m, killed in results:
            writer.writerow((m.room, m.path, m.line, m.kind, int(killed), m.source))
    share = sum(killed for _, killed in results) / max(len(results), 1)
    print(f"{share:.1%} of {len(results)} mutants killed")
    return 0 if share >= 0.85 else 1


if __name__ == "__main__":
    sys.exit(main())
