# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Planning with a radio map, against networkx and hand-made levels."""

from __future__ import annotations

import heapq
import itertools
import math

import networkx as nx
import numpy as np
import pytest

from slarm_graph.errors import BadInput
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.connectivity.coverage import TOGETHER, connections
from slarm_graph.radio.connectivity.paths import connected_path
from slarm_graph.radio.connectivity.signal import SignalMap, noise_floor_dbm

GRID = GridGeometry(0.0, 0.0, 0.5, 20, 30)


def graph(allowed, weights):
    made = nx.Graph()
    for r, c in np.argwhere(allowed).tolist():
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            a, b = r + dr, c + dc
            if not (a < allowed.shape[0] and 0 <= b < allowed.shape[1] and allowed[a, b]):
                continue
            if allowed[r, b] and allowed[a, c]:
                made.add_edge((r, c), (a, b), weight=math.hypot(dr, dc), into=weights)
    return made


def levels(seed=0):
    rng = np.random.default_rng(seed)
    level = rng.uniform(-90.0, -60.0, GRID.shape).astype(np.float32)
    level[rng.uniform(size=GRID.shape) < 0.15] = np.nan
    level[0, 0] = level[-1, -1] = -50.0
    return level


ENDS = ((0.25, 0.25), (14.75, 9.75))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("outage_m", [0.0, math.inf])
def test_paths_are_as_short_as_networkx_says(seed, outage_m):
    level = levels(seed)
    with np.errstate(invalid="ignore"):
        allowed = np.isfinite(level) & ((level >= -82.0) | (outage_m > 0.0))
    made = connected_path(GRID, level, *ENDS, -82.0, longest_outage_m=outage_m)
    try:
        length = nx.shortest_path_length(graph(allowed, None), (0, 0), (19, 29), weight="weight")
    except (nx.NetworkXNoPath, nx.NodeNotFound):
        assert made is None
        return
    assert made.length_m == pytest.approx(0.5 * length, abs=1e-4)
    assert made.least_dbm >= -82.0 or outage_m > 0.0


@pytest.mark.parametrize("seed", range(6))
def test_weighed_paths_between_any_two_places_cost_least(seed):
    """Dijkstra over the directed steps, each with the weight of the cell it leads to."""
    level, rng = levels(seed), np.random.default_rng(seed)
    weight = 1.0 + 0.3 * np.maximum(-75.0 - level, 0.0)
    steps = nx.DiGraph()
    for a, b, data in graph(np.isfinite(level), None).edges(data=True):
        steps.add_edge(a, b, cost=data["weight"] * weight[b])
        steps.add_edge(b, a, cost=data["weight"] * weight[a])
    floor = np.argwhere(np.isfinite(level))
    start, goal = (tuple(cell) for cell in rng.choice(floor, 2, replace=False).tolist())
    ends = [(0.5 * col + 0.25, 0.5 * row + 0.25) for row, col in (start, goal)]
    made = connected_path(GRID, level, *ends, -75.0, longest_outage_m=math.inf, weight_per_db=0.3)
    if not (start in steps and nx.has_path(steps, start, goal)):
        assert made is None
        return
    cells = [tuple(cell) for cell in made.cells.tolist()]
    assert (cells[0], cells[-1]) == (start, goal)
    cost = sum(steps.edges[a, b]["cost"] for a, b in itertools.pairwise(cells))
    least = nx.shortest_path_length(steps, start, goal, weight="cost")
    assert cost == pytest.approx(least, rel=1e-5)


def corridor(gap):
    """A straight way with a gap in coverage, and a longer way round that is covered."""
    level = np.full((9, 30), np.nan, dtype=np.float32)
    level[[1, 7], 1:29] = -60.0
    level[1:8, [1, 28]] = -60.0
    level[1, 10 : 10 + gap] = -95.0
    return level


def test_the_longest_outage_decides_between_ways():
    grid = GridGeometry(0.0, 0.0, 0.5, 9, 30)
    ends = (0.75, 0.75), (14.25, 0.75)
    level = corridor(gap=6)
    straight = connected_path(grid, level, *ends, -80.0, longest_outage_m=3.1)
    assert straight.length_m == pytest.approx(13.5)
    assert straight.longest_below_m == pytest.approx(3.0)
    around = connected_path(grid, level, *ends, -80.0, longest_outage_m=2.9)
    assert around.longest_below_m == 0.0
    assert around.length_m == pytest.approx(13.5 + 6.0)
    weighed = connected_path(
        grid, level, *ends, -80.0, longest_outage_m=math.inf, weight_per_db=0.5
    )
    assert weighed.longest_below_m == 0.0
    nothing = connected_path(grid, level, *ends, -50.0)
    assert nothing is None
    with pytest.raises(BadInput, match="not on the floor"):
        connected_path(grid, level, (2.25, 2.25), ends[1], -80.0)


def shortest_within(level, start, goal, limit):
    """Brute force: Dijkstra over cells and the exact length without connection so far [cells]."""
    best, heap = {}, [(0.0, start, 0.0)]
    while heap:
        length, (row, col), lost = heapq.heappop(heap)
        if (row, col) == goal:
            return length
        if any(so_far <= lost + 1e-9 for so_far in best.get((row, col), ())):
            continue
        best.setdefault((row, col), []).append(lost)
        for dr, dc in itertools.product((-1, 0, 1), repeat=2):
            r, c = row + dr, col + dc
            if not (0 <= r < level.shape[0] and 0 <= c < level.shape[1]) or (dr == dc == 0):
                continue
            if np.isnan(level[[r, r, row], [c, col, c]]).any():
                continue
            step = math.hypot(dr, dc)
            without = 0.0 if level[r, c] >= -80.0 else lost + step
            if without <= limit:
                heapq.heappush(heap, (length + step, (r, c), without))
    return None


def test_ways_with_a_longest_outage_are_nearly_always_the_shortest():
    """Never longer without connection than allowed, nor shorter than can be; seldom longer."""
    grid, longer, found = GridGeometry(0.0, 0.0, 1.0, 9, 9), 0, 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        level = rng.choice(
            np.array([-60.0, -95.0, np.nan], dtype=np.float32), (9, 9), p=[0.4, 0.5, 0.1]
        )
        level[0, 0] = level[8, 8] = -60.0
        limit = float(rng.choice([1.5, 2.5, 4.0]))
        made = connected_path(grid, level, (0.5, 0.5), (8.5, 8.5), -80.0, longest_outage_m=limit)
        least = shortest_within(level, (0, 0), (8, 8), limit)
        if made is None:
            assert least is None
            continue
        found += 1
        assert made.longest_below_m <= limit + 1e-6
        assert made.length_m >= least - 1e-4
        longer += made.length_m > least + 1e-4
    assert found > 20
    assert longer == 0


def signal():
    level = np.full((2, 4, 5), -70.0, dtype=np.float32)
    level[1] = -80.0
    level[1, :, 3:] = -60.0
    level[:, 0] = np.nan
    return SignalMap(GridGeometry(0, 0, 1.0, 4, 5), ("a", "b"), level, np.full_like(level, 5.0))


def test_servers_ratios_and_outage_by_hand():
    made = signal()
    assert (made.best_server()[0] == -1).all()
    assert (made.best_server()[1:, :3] == 0).all()
    assert (made.best_server()[1:, 3:] == 1).all()
    np.testing.assert_allclose(made.snr_db(-95.0)[1:, :3], 25.0)
    expected = -70.0 - 10 * np.log10(10**-8.0 + 10**-9.5)
    np.testing.assert_allclose(made.sinr_db(-95.0)[1:, :3], expected, atol=1e-4)
    # Each at its threshold fails half of the time; the other is two sigmas below it.
    np.testing.assert_allclose(made.outage(-70.0)[1, 0], 0.5 * 0.97725, atol=1e-4)
    assert noise_floor_dbm(20e6, 7.0) == pytest.approx(-174 + 73.01 + 7, abs=0.01)


def test_connected_area_of_each_and_all():
    one, other, both = connections(signal(), -75.0)
    assert (one.share, other.share, both.share) == (1.0, 0.4, 1.0)
    assert both.name == TOGETHER
    assert one.area_m2 == 15.0
    assert other.largest_share == 0.4
    assert both.mean_outage < min(one.mean_outage, other.mean_outage)
