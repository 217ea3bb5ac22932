# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The g2o reader and writer: exact round trips, tolerance, and errors that name the line."""

from __future__ import annotations

from pathlib import Path

import gtsam
import numpy as np
import pytest

from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.errors import BadInput
from slarm_graph.files.g2o import read_g2o, write_g2o
from slarm_graph.geometry import Pose2


def small_graph() -> PoseGraph:
    """Three poses, two steps and one closure with full covariances."""
    rng = np.random.default_rng(3)
    poses = rng.normal(size=(3, 3))
    constraints = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        root = rng.normal(size=(3, 3))
        covariance = root @ root.T + 0.1 * np.eye(3)
        kind = ConstraintKind.ODOMETRY if j == i + 1 else ConstraintKind.LOOP_CLOSURE
        constraints.append(Constraint(i, j, Pose2(*rng.normal(size=3)), covariance, kind))
    return PoseGraph(poses, tuple(constraints))


def test_round_trip(tmp_path: Path) -> None:
    graph = small_graph()
    path = tmp_path / "graph.g2o"
    write_g2o(path, graph)
    again = read_g2o(path)
    assert np.array_equal(again.graph.poses, graph.poses)
    assert again.fixed == (0,)
    for a, b in zip(again.graph.constraints, graph.constraints, strict=True):
        assert (a.i, a.j, a.i_from_j, a.kind) == (b.i, b.j, b.i_from_j, b.kind)
        assert np.allclose(a.covariance, b.covariance, rtol=1e-12, atol=0)


def test_gtsam_reads_what_we_write(tmp_path: Path) -> None:
    graph = small_graph()
    path = tmp_path / "graph.g2o"
    write_g2o(path, graph)
    factors, values = gtsam.readG2o(str(path), False)
    assert factors.size() == 3
    for index, pose in enumerate(graph.poses):
        assert np.allclose(values.atPose2(index).matrix(), gtsam.Pose2(*pose).matrix(), atol=1e-12)


def test_last_line_fixes(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    write_g2o(path, small_graph())
    assert path.read_text().splitlines()[-1] == "FIX 0"


def test_tolerates_comments_early_fix_gaps_and_unknown_tags(tmp_path: Path) -> None:
    path = tmp_path / "loose.g2o"
    path.write_text(
        "\ufeff# made by hand\r\nFIX 10\r\nVERTEX_SE2 10 0 0 0 # first\r\n\r\n"
        "PARAMS_SE2OFFSET 0 0 0 0\r\nEDGE_SE2 10 30 1 0 0 1 0 0 1 0 1\r\nVERTEX_SE2 30 1 0 0\r\n"
        "EDGE_SE2 30 40 1 0 0 1 0 0 1 0 1\r\n"
    )
    read = read_g2o(path)
    assert read.ids == (10, 30, 40)
    assert read.fixed == (0,)
    assert read.other_tags == {"PARAMS_SE2OFFSET": 1}
    assert np.allclose(read.graph.poses[2], [2.0, 0.0, 0.0])
    assert [(c.i, c.j) for c in read.graph.constraints] == [(0, 1), (1, 2)]


def test_edges_that_run_backwards_chain_poses_and_are_no_odometry(tmp_path: Path) -> None:
    """The same graph with every edge told from its other end places every pose as before."""
    steps = [(0, 1, Pose2(1.0, 0.2, 0.4)), (1, 2, Pose2(0.8, -0.3, -1.1)), (2, 3, Pose2(1, 1, 2))]
    forth = "".join(f"EDGE_SE2 {i} {j} {s.x} {s.y} {s.theta} 1 0 0 1 0 1\n" for i, j, s in steps)
    turned = [(j, i, s.inverse()) for i, j, s in steps]
    back = "".join(f"EDGE_SE2 {i} {j} {s.x} {s.y} {s.theta} 1 0 0 1 0 1\n" for i, j, s in turned)
    graphs = []
    for name, text in (("forth", forth), ("back", back)):
        (tmp_path / name).write_text("VERTEX_SE2 0 0.5 -0.5 0.3\n" + text)
        graphs.append(read_g2o(tmp_path / name).graph)
    at = Pose2(0.5, -0.5, 0.3)
    for index, (_, _, step) in enumerate(steps, start=1):
        at = at @ step
        for graph in graphs:
            assert np.allclose(graph.poses[index], at.as_array(), atol=1e-12)
    assert {c.kind for c in graphs[0].constraints} == {ConstraintKind.ODOMETRY}
    assert {c.kind for c in graphs[1].constraints} == {ConstraintKind.LOOP_CLOSURE}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("VERTEX_SE2 0 0 0\n", ":1: expected 3 numbers, got 2"),
        ("VERTEX_SE2 0 0 0 nan\n", ":1: a number is not finite"),
        ("VERTEX_SE2 a 0 0 0\n", ":1: expected a whole number"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0\n", ":2: vertex 0 is given twice"),
        ("EDGE_SE2 0 1 1 0 0 -1 0 0 1 0 1\n", ":1: the information matrix is not positive"),
        ("EDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n", ":1: the edge joins vertex 0 to itself"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "no VERTEX_SE2 or EDGE_SE2 lines"),
        (
            "V" + "9" * 5000 + " 1\n",
            r"or EDGE_SE2 lines \(found: V9{10,200}\.\.\.\)$",
        ),
        ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 5 6 1 0 0 1 0 0 1 0 1\n", "vertex 5 has edges but"),
        ("VERTEX_SE2 0 0 0 0\nFIX 7\n", "FIX names vertex 7"),
    ],
)
def test_errors_name_the_place(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text(text)
    with pytest.raises(BadInput, match=said):
        read_g2o(path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be read"):
        read_g2o(tmp_path / "none.g2o")
