# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a first run compiles: nothing twice, and none of numba's long ways to do something short."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import numpy as np
import pytest
from test_names import ROOT, modules

from slarm_graph.frontends.scans import correlative, gauss_newton, wall_sides, wall_tangents
from slarm_graph.frontends.scans.likelihood_grid import build_likelihood_grid, scan_segments
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.geometry import Pose2

IN_EVERY_RUN = ("frontends/scans", "slarm_graph/consistency", "slarm_graph/mapping")
IN_EVERY_RUN += ("slarm_graph/radio", "slarm_graph/raster", "slarm_graph/recovery")


def test_kernels_are_not_compiled_for_single_values() -> None:
    points = np.stack([np.linspace(-3.0, 3.0, 60), np.full(60, 2.0)], axis=1)
    segments = scan_segments(points, np.zeros(3), 0.5)
    grid = build_likelihood_grid(segments, resolution_m=0.05, sigma_m=0.1)
    gauss_newton.refine_near(grid, points, np.zeros(3), np.eye(3), 1.0, 5)
    pyramid = build_pyramid(grid, levels=3, max_radius_m=5.0)
    correlative.search(pyramid, points, Pose2(), reach_m=0.2, reach_rad=0.1)
    wall_sides.own_surfaces(points)
    wall_tangents.wall_tangents(points)
    for caller, kernel in (
        (gauss_newton.refine, gauss_newton._normal_equations),
        (wall_tangents.wall_tangents, wall_tangents._along),
        (wall_sides.own_surfaces, wall_sides._end),
        (correlative._roots, correlative._admit),
    ):
        caller.recompile()  # one from the cache does not tell what it calls
        kinds = [str(kind) for signature in kernel.signatures for kind in signature]
        assert kinds
        assert [kind for kind in kinds if "Literal" in kind] == []


@pytest.mark.parametrize("seed", range(20))
def test_children_are_stacked_as_a_stable_sort_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    children = rng.integers(0, 4, (8, 4))
    stack = np.full((12, 5), -1)
    assert correlative._push(stack, 3, children, 7, 5) == 10
    order = np.argsort(children[:7, 3], kind="stable")
    np.testing.assert_array_equal(stack[3:10, :4], children[order])
    assert set(stack[3:10, 4]) == {5}
    assert set(stack[:3].ravel()) | set(stack[10:].ravel()) == {-1}


def kernels() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield every compiled function of the rooms that every run passes, with its place."""
    for path in modules():
        place = str(path.relative_to(ROOT))
        if place.startswith(IN_EVERY_RUN):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef) and "kernel" in "".join(
                    map(ast.unparse, node.decorator_list)
                ):
                    yield f"{place}:{node.name}", node


def test_kernels_copy_in_loops_and_sort_elsewhere() -> None:
    """For an array put into a slice numba compiles the words of an error, forty functions."""
    found = []
    for place, kernel in kernels():
        for node in ast.walk(kernel):
            into = node.targets[0] if isinstance(node, ast.Assign) else None
            if isinstance(into, ast.Subscript) and not isinstance(node.value, ast.Constant):
                slices = [part for part in ast.walk(into.slice) if isinstance(part, ast.Slice)]
                found += [f"{place}: {ast.unparse(node)}"] if slices else []
            if isinstance(node, ast.Attribute) and node.attr in ("argsort", "median"):
                found.append(f"{place}: {ast.unparse(node)}")
    assert len(list(kernels())) > 50
    assert found == []
