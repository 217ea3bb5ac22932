# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording out of MIT's Killian Court, from a pose graph that has its scans.

    python benchmarks/killian.py killian.g2o OUT.log [--noise 0.05] [--seed 1]

The graph (3873 scans, one per half metre, 1.9 km with loops of 600 m) is in `rtb-data` 2.0.0 on
PyPI, `rtbdata/data/killian.g2o.zip`. Its edges between scans in a row are somebody else's matches
and take the place of odometry; with noise they drift as odometry does.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from slarm_graph.geometry import Floats, compose

_TURN_PER_M, _TURN_PER_RAD, _BIAS_RAD_PER_M = 0.2, 0.5, 0.06
"""Of the noise, as shares: heading noise per metre and per radian, and a constant drift."""


def drifting(steps: Floats, noise: float, rng: np.random.Generator) -> Floats:
    """Add to steps (N, 3) what odometry errs by.

    Parameters
    ----------
    steps : (N, 3) float64
        Motions in the body frame [m, m, rad].
    noise : float
        Standard deviation of a step's length, as a share of it.
    rng : Generator
    """
    way_m = np.hypot(steps[:, 0], steps[:, 1])
    drawn = noise * rng.normal(size=(len(steps), 4))
    turn = _TURN_PER_M * way_m + _TURN_PER_RAD * np.abs(steps[:, 2])
    return np.column_stack(
        [
            steps[:, 0] * (1.0 + drawn[:, 0]),
            steps[:, 1] + drawn[:, 1] * way_m,
            steps[:, 2] + drawn[:, 2] * turn + noise * _BIAS_RAD_PER_M * way_m,
        ]
    )


def converted(graph: Path, noise: float, seed: int) -> list[str]:
    """Return the lines of a CARMEN log of a graph with scans."""
    lines = [line.split() for line in graph.read_text().splitlines()]
    scans = [line for line in lines if line and line[0] == "ROBOTLASER1"]
    edges = [line for line in lines if line and line[0] == "EDGE_SE2"]
    steps = {int(e[1]): list(map(float, e[3:6])) for e in edges if int(e[2]) == int(e[1]) + 1}
    told = np.array([steps[k] for k in range(len(scans) - 1)])
    pose, made = np.zeros(3), []
    for k, scan in enumerate(scans):
        if k:
            step = drifting(told[k - 1 : k], noise, np.random.default_rng((seed, k)))[0]
            pose = compose(pose, step)
        place = " ".join(f"{v:.6f}" for v in (*pose, *pose))
        stamp = f"{float(scan[-1]):.6f}"
        made.append(
            " ".join([*scan[: 9 + int(scan[8])], "0", place, "0 0 0.3 0.3 1000", stamp, "x", stamp])
        )
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("graph", type=Path)
    parser.add_argument("log", type=Path)
    parser.add_argument("--noise", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    lines = converted(asked.graph, asked.noise, asked.seed)
    asked.log.write_text("\n".join(lines) + "\n")
    way_m = math.hypot(*(float(v) for v in lines[-1].split()[-11:-9]))
    print(f"{len(lines)} scans; odometry ends {way_m:.0f} m from where it began")


if __name__ == "__main__":
    main()
