# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Optimise the pose graph of a g2o file, and count the cells of a map.

python examples/graphs_and_maps.py graph.g2o map.yaml OUT
"""

import sys
from pathlib import Path

import numpy as np

from slarm_graph import (
    marginal_covariances,
    optimize_graph,
    read_g2o,
    read_map,
    write_g2o,
    write_map,
)


def main(graph_file: str, map_file: str, out: str) -> None:
    """Read, use and write both."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    graph = read_g2o(Path(graph_file)).graph
    best = optimize_graph(graph)
    write_g2o(folder / "graph.g2o", best)
    (last,) = marginal_covariances(best, [len(best.poses) - 1])
    print(f"the last pose is known to {np.sqrt(np.diag(last)[:2]).max():.3f} m")
    grid = read_map(Path(map_file))
    write_map(folder / "map.yaml", grid)
    print(f"{grid.occupied.sum()} occupied and {grid.free.sum()} free cells")


if __name__ == "__main__":
    main(*sys.argv[1:])
