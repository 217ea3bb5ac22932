# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Coverage path through a known world, to make recordings of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.raster.distance import clearance
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

_CLEARANCE_M = 0.06
"""More than the 0.05 m that the driver of recordings deviates from its path, so that it never
scrapes a wall."""
_WALL_COST_M = 0.5
"""Clearance below which a step costs up to four times as much: people drive in the middle of wide
passages."""
_WAYPOINT_EVERY_M = 0.3
"""Half a robot's width; fewer cut corners, more make the recorded drive stutter."""


def tour_waypoints_m(
    world: WorldMap, body_radius_m: float, *, spacing_m: float = 2.5, resolution_m: float = 0.1
) -> Floats:
    """Waypoints (N, 2) [m] that come within about `spacing_m` of every reachable cell.

    Greedily visits the nearest cell not yet covered, and returns to the start at the end, so that a
    recording of it closes loops.

    Raises
    ------
    BadInput
        When the body cannot leave the start.
    """
    truth = truth_map(world, resolution_m, "touched")
    clearance_m = clearance(~truth.blocked).astype(np.float64) * resolution_m
    # Distances between cell centres overstate the clearance by up to half a cell.
    passable = clearance_m - 0.5 * resolution_m > body_radius_m + _CLEARANCE_M
    graph, cells = _graph(passable, clearance_m, resolution_m)
    start = _nearest_node(truth.geometry, cells, (world.start.x, world.start.y))
    if start is None:
        raise BadInput(f"{world.name}: there is no room for a robot of {body_radius_m} m radius")
    nodes = _visit_all(graph, start, truth.geometry.center_of(cells), spacing_m)
    stride = max(1, round(_WAYPOINT_EVERY_M / resolution_m))
    kept = _thin(nodes, stride)
    return truth.geometry.center_of(cells[kept])


def _graph(
    passable: Mask, clearance_m: Floats, resolution_m: float
) -> tuple[sparse.csr_matrix, NDArray[np.int64]]:
    """8-connected graph over passable cells; steps near walls cost more."""
    index = np.full(passable.shape, -1, dtype=np.int64)
    cells = np.argwhere(passable)
    index[passable] = np.arange(len(cells))
    cost_factor = 1.0 + 3.0 * np.clip(1.0 - clearance_m / _WALL_COST_M, 0.0, 1.0)
    rows, cols, costs = [], [], []
    for d_row, d_col in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = cells[(cells[:, 0] + d_row < passable.shape[0])]
        here = here[(here[:, 1] + d_col >= 0) & (here[:, 1] + d_col < passable.shape[1])]
        there = here + np.array([d_row, d_col])
        # A diagonal step needs both side cells free.
        is_free = passable[there[:, 0], there[:, 1]]
        is_free &= passable[here[:, 0], there[:, 1]] & passable[there[:, 0], here[:, 1]]
        here, there = here[is_free], there[is_free]
        rows.append(index[here[:, 0], here[:, 1]])
        cols.append(index[there[:, 0], there[:, 1]])
        mean = 0.5 * (cost_factor[here[:, 0], here[:, 1]] + cost_factor[there[:, 0], there[:, 1]])
        costs.append(mean * np.hypot(d_row, d_col) * resolution_m)
    data = (np.concatenate(costs), (np.concatenate(rows), np.concatenate(cols)))
    one_way = sparse.csr_matrix(data, shape=(len(cells), len(cells)))
    # Both ways are stored: scipy would mirror an undirected graph anew in every search.
    return one_way + one_way.T, cells


def _nearest_node(
    geometry: GridGeometry, cells: NDArray[np.int64], point_m: tuple[float, float]
) -> int | None:
    if not len(cells):
        return None
    return int(np.argmin(np.linalg.norm(geometry.center_of(cells) - point_m, axis=1)))


def _visit_all(
    graph: sparse.csr_matrix, start: int, centers_m: Floats, spacing_m: float
) -> list[int]:
    """Go to the nearest node not within `spacing_m` of the path so far, until there is none."""
    unvisited = np.isfinite(_search(graph, start, None, np.inf)[0])
    path, tree = [start], cKDTree(centers_m)
    unvisited[tree.query_ball_point(centers_m[start], spacing_m)] = False
    while unvisited.any():
        costs, predecessors = _search(graph, path[-1], unvisited, 4.0 * spacing_m)
        leg = _leg(predecessors, int(np.argmin(np.where(unvisited, costs, np.inf))))
        path += leg
        for node in leg[::5] + leg[-1:]:
            unvisited[tree.query_ball_point(centers_m[node], spacing_m)] = False
    return path + _leg(_search(graph, path[-1], None, np.inf)[1], start)


def _search(
    graph: sparse.csr_matrix, node: int, unvisited: Mask | None, limit: float
) -> tuple[Floats, NDArray[np.int32]]:
    """Costs from a node and predecessors (Dijkstra), out to the first unvisited node."""
    while True:
        costs, predecessors = csgraph.dijkstra(
            graph, indices=node, return_predecessors=True, limit=limit
        )
        if unvisited is None or np.isfinite(costs[unvisited]).any():
            return costs, predecessors
        limit *= 3.0


def _leg(predecessors: NDArray[np.int32], target: int) -> list[int]:
    leg = []
    node = target
    while predecessors[node] >= 0:
        leg.append(node)
        node = int(predecessors[node])
    return leg[::-1]


def _thin(nodes: list[int], stride: int) -> list[int]:
    kept = nodes[::stride]
    return kept if nodes and kept[-1] == nodes[-1] else [*kept, nodes[-1]]
