# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose graphs as g2o text: `VERTEX_SE2`, `EDGE_SE2` and `FIX`, exact to the last bit."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.errors import BadInput, brief
from slarm_graph.geometry import Floats, Pose2, symmetric

_UPPER = np.triu_indices(3)
"""Places of g2o's six numbers in a symmetric 3 x 3 matrix, row by row."""


@dataclass(frozen=True, slots=True)
class G2oFile:
    """A pose graph read from a g2o file.

    Parameters
    ----------
    graph : PoseGraph
        Poses in ascending order of their identifiers; constraints in the order of the file.
    ids : tuple of int
        Identifier of each pose in the file.
    fixed : tuple of int
        Indices of poses the file holds fixed.
    other_tags : dict of str to int
        Ignored tags, with their number of lines.
    """

    graph: PoseGraph
    ids: tuple[int, ...]
    fixed: tuple[int, ...] = ()
    other_tags: dict[str, int] = field(default_factory=dict)


def write_g2o(path: Path, graph: PoseGraph) -> None:
    """Write a pose graph with pose 0 fixed, 17 significant digits and identifiers 0 ... N-1.

    `EDGE_SE2 i j dx dy dtheta I11 I12 I13 I22 I23 I33` holds the information matrix in the order
    (x, y, theta). `FIX` comes last, because some readers drop edges that follow it.
    """
    with path.open("w", encoding="ascii", newline="\n") as out:
        for index, pose in enumerate(graph.poses):
            out.write(f"VERTEX_SE2 {index} {_numbers(pose)}\n")
        for c in graph.constraints:
            upper = symmetric(np.linalg.inv(c.covariance))[_UPPER]
            out.write(f"EDGE_SE2 {c.i} {c.j} {_numbers(c.i_from_j.as_array())} {_numbers(upper)}\n")
        if len(graph.poses):
            out.write("FIX 0\n")


def read_g2o(path: Path) -> G2oFile:
    """Read a two-dimensional g2o file.

    Comments, blank lines and a `FIX` anywhere are tolerated; unknown tags are counted. Poses with
    edges but no vertex line are chained from their neighbours.

    Raises
    ------
    BadInput
        Naming file and line, when a line is malformed, a vertex is given twice, an information
        matrix is not positive definite or a pose cannot be placed.
    """
    vertices: dict[int, Floats] = {}
    edges: list[tuple[int, int, Constraint]] = []
    fixed: list[int] = []
    other: Counter[str] = Counter()
    for where, tag, words in _lines(path):
        if tag == "VERTEX_SE2":
            key = _ids(words, 1, where)[0]
            if key in vertices:
                raise BadInput(f"{where}: vertex {key} is given twice; remove one of the lines")
            vertices[key] = _floats(words[1:], 3, where)
        elif tag == "EDGE_SE2":
            edges.append(_edge(words, where))
        elif tag == "FIX":
            fixed.extend(_ids(words, len(words), where))
        else:
            other[tag] += 1
    if not vertices and not edges:
        seen = brief(", ".join(other)) or "nothing"
        raise BadInput(f"{path}: no VERTEX_SE2 or EDGE_SE2 lines (found: {seen})")
    return _assemble(path, vertices, edges, fixed, other)


def _assemble(
    path: Path,
    vertices: dict[int, Floats],
    edges: list[tuple[int, int, Constraint]],
    fixed: list[int],
    other: Counter[str],
) -> G2oFile:
    """Number the poses 0 ... N-1 in ascending order of their identifiers."""
    _chain_missing(path, vertices, edges)
    ids = tuple(sorted(vertices))
    index_of = {key: index for index, key in enumerate(ids)}
    unknown = [key for key in fixed if key not in index_of]
    if unknown:
        raise BadInput(f"{path}: FIX names vertex {unknown[0]}, which does not exist")
    constraints = tuple(
        Constraint(index_of[i], index_of[j], c.i_from_j, c.covariance, c.kind) for i, j, c in edges
    )
    poses = np.array([vertices[key] for key in ids]).reshape(-1, 3)
    fixed_indices = tuple(index_of[key] for key in fixed)
    return G2oFile(PoseGraph(poses, constraints), ids, fixed_indices, dict(other))


def _chain_missing(
    path: Path, vertices: dict[int, Floats], edges: list[tuple[int, int, Constraint]]
) -> None:
    """Compute poses without vertex line from their edges, breadth first from known ones."""
    mentioned = {key for i, j, _ in edges for key in (i, j)}
    if mentioned <= vertices.keys():
        return
    neighbours: defaultdict[int, list[tuple[int, Pose2]]] = defaultdict(list)
    for i, j, c in edges:
        neighbours[i].append((j, c.i_from_j))
        neighbours[j].append((i, c.i_from_j.inverse()))
    if not vertices:
        vertices[min(mentioned)] = np.zeros(3)
    queue = sorted(vertices)
    for key in queue:
        for other, key_from_other in neighbours[key]:
            if other not in vertices:
                vertices[other] = (Pose2.from_array(vertices[key]) @ key_from_other).as_array()
                queue.append(other)
    lost = sorted(mentioned - vertices.keys())
    if lost:
        raise BadInput(
            f"{path}: vertex {lost[0]} has edges but no VERTEX_SE2 line and no path to one"
        )


def _lines(path: Path) -> Iterator[tuple[str, str, list[str]]]:
    """Yield `file:line`, tag and remaining words of every line that is not blank or a comment."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read as a g2o file ({error})") from error
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", maxsplit=1)[0].split()
        if words:
            yield f"{path}:{number}", words[0], words[1:]


def _edge(words: list[str], where: str) -> tuple[int, int, Constraint]:
    i, j = _ids(words, 2, where)
    if i == j:
        raise BadInput(f"{where}: the edge joins vertex {i} to itself")
    values = _floats(words[2:], 9, where)
    information = np.zeros((3, 3))
    information[_UPPER] = values[3:]
    information += np.triu(information, 1).T
    if not np.linalg.eigvalsh(information)[0] > 0.0:
        raise BadInput(f"{where}: the information matrix is not positive definite: {values[3:]}")
    kind = ConstraintKind.ODOMETRY if j == i + 1 else ConstraintKind.LOOP_CLOSURE
    measured = Pose2.from_array(values[:3])
    covariance: Floats = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return i, j, Constraint(i, j, measured, covariance, kind)


def _ids(words: list[str], count: int, where: str) -> list[int]:
    """Parse the leading `count` identifiers."""
    try:
        ids = [int(word) for word in words[:count]]
    except ValueError:
        raise BadInput(
            f"{where}: expected a whole number, got {brief(' '.join(words[:count]))!r}"
        ) from None
    if len(ids) < count or any(key < 0 for key in ids):
        raise BadInput(
            f"{where}: expected {count} identifiers from 0 on, got {brief(words[:count])}"
        )
    return ids


def _floats(words: list[str], count: int, where: str) -> Floats:
    """Parse exactly `count` finite numbers."""
    if len(words) != count:
        raise BadInput(f"{where}: expected {count} numbers, got {len(words)}")
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise BadInput(f"{where}: expected numbers, got {brief(' '.join(words))!r}") from None
    if not all(math.isfinite(value) for value in values):
        raise BadInput(f"{where}: a number is not finite: {brief(' '.join(words))!r}")
    return np.array(values)


def _numbers(values: Floats) -> str:
    return " ".join(f"{value:.17g}" for value in values)
