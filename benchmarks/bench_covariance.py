# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether covariances are as large as errors: NEES in simulated worlds, chi2 of real graphs.

    python benchmarks/bench_covariance.py worlds [--backend NAME] [--worlds 8] [--seed 0]
    python benchmarks/bench_covariance.py graphs intel.clf.gz fr079.bag ...

NEES is the squared error of a pose, in its body frame and as seen from the first pose, whitened by
its covariance and divided by its three degrees of freedom: 1 where the covariance is right, more
where it promises too much. The poses of one drive err together, so a single drive tells little; the
mean is over drives. Chi2 of factors is divided by what the adjustment left of their degrees of
freedom: three a factor, less the share that was used up to place the poses (redundancy numbers;
Baarda, "A Testing Procedure for Use in Geodetic Networks", 1968).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slarm_graph import backends
from slarm_graph.backend import SlamResult, silent
from slarm_graph.backends.pose_graph_optimizer import chi2_each
from slarm_graph.backends.variance_components import redundancies
from slarm_graph.config import RunConfig, SimulationConfig, SourceConfig
from slarm_graph.constraint import ConstraintKind, PoseGraph
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld
from slarm_graph.geometry import Floats, Pose2, between
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

_SLIP = 0.05
"""Of either wheel, one too far and one too short: 5 %, as in the random worlds of the targets."""


@dataclass(frozen=True, slots=True)
class Sensors:
    """A robot: what it sees, how far, how well, and how much its wheels slip."""

    view_deg: float = 360.0
    range_m: float = 12.0
    noise_m: float = 0.01
    slip: float = 0.001

    def config(self) -> SimulationConfig:
        """Return the settings of the simulator; a beam per degree."""
        plain = SimulationConfig()
        lidar = plain.lidar.model_copy(
            update={
                "beams": round(self.view_deg),
                "field_of_view_rad": math.radians(self.view_deg),
                "range_max_m": self.range_m,
                "sigma_m": self.noise_m,
            }
        )
        wheels = plain.wheels.model_copy(update={"left_slip": self.slip, "right_slip": -self.slip})
        return plain.model_copy(update={"lidar": lidar, "wheels": wheels})


SETTINGS = (
    Sensors(),
    Sensors(view_deg=180.0),
    Sensors(view_deg=90.0),
    Sensors(range_m=5.6),
    Sensors(range_m=30.0),
    Sensors(noise_m=0.03),
    Sensors(slip=_SLIP),
    Sensors(view_deg=180.0, range_m=5.6, noise_m=0.03, slip=_SLIP),
)
"""One thing changed at a time, and all that is bad together."""


def nees(trajectory: Trajectory, covariances: Floats, truth: Trajectory) -> Floats:
    """Return the NEES per degree of freedom (N - 1,) of all poses but the first.

    Parameters
    ----------
    trajectory : Trajectory
        `map_from_robot`.
    covariances : (N, 3, 3) float64
        In the robot's frame.
    truth : Trajectory
        At the same stamps, in any fixed frame.
    """
    seen = between(trajectory.poses[0], trajectory.poses)
    true = between(truth.poses[0], truth.poses)
    off = [Pose2.from_array(pose).log() for pose in between(seen, true)[1:]]
    whitened = np.linalg.solve(covariances[1:], np.array(off)[:, :, None])[:, :, 0]
    return np.asarray((np.array(off) * whitened).sum(axis=1) / 3.0)


def chi2_by_kind(graph: PoseGraph) -> dict[str, tuple[int, float, float]]:
    """Return the number of constraints, chi2 and degrees of freedom of every kind and of all."""
    squares, left = chi2_each(graph), redundancies(graph)
    if left is None:
        return {}
    kinds = np.array([str(c.kind) for c in graph.constraints])
    groups = {"all": np.ones(len(kinds), dtype=bool)}
    groups |= {str(kind): kinds == str(kind) for kind in ConstraintKind}
    return {
        name: (int(of.sum()), float(squares[of].sum()), float(left[of].sum()))
        for name, of in groups.items()
        if of.any()
    }


def slam(readings: list[Reading], backend: str) -> SlamResult:
    """Run a backend with its defaults."""
    config = RunConfig(backend=backend)
    made = backends.make(backend, config, np.random.default_rng(config.seed), silent)
    for reading in readings:
        made.update(reading)
    return made.result()


def world_rows(backend: str, worlds: int, seed: int) -> Iterator[str]:
    """Drive through random worlds with every sensor; rows of a table."""
    yield "| backend | view | range | noise | slip | NEES/dof of drives | mean | median | ATE [m] |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for sensors in SETTINGS:
        means, medians, ates = [], [], []
        for number in range(seed, seed + worlds):
            world = random_world(np.random.default_rng(number))
            source = SourceFromWorld(world, sensors.config(), seed=number)
            result, truth = slam(list(source), backend), source.truth()
            seen, true = (between(t.poses[0], t.poses) for t in (result.trajectory, truth))
            ates.append(float(np.sqrt(np.square((seen - true)[:, :2]).sum(axis=1).mean())))
            if result.covariances is not None:
                each = nees(result.trajectory, result.covariances, truth)
                means.append(float(each.mean()))
                medians.append(float(np.median(each)))
        told = ", ".join(f"{m:.2f}" for m in means) or "unknown"
        yield (
            f"| {backend} | {sensors.view_deg:.0f} | {sensors.range_m} | {sensors.noise_m}"
            f" | {sensors.slip} | {told} | {_mean_and_error(means)}"
            f" | {np.mean(medians or [np.nan]):.2f} | {max(ates):.4f} |"
        )


def _mean_and_error(values: list[float]) -> str:
    """Return a mean and its standard error: the poses of one drive err together."""
    if len(values) < 2:
        return f"{np.mean(values or [np.nan]):.2f}"
    error = np.std(values, ddof=1) / math.sqrt(len(values))
    return f"{np.mean(values):.2f} +- {error:.2f}"


def graph_rows(recordings: list[Path]) -> Iterator[str]:
    """Weigh the final graphs of recordings; rows of a table."""
    yield "| recording | kind | constraints | dof | chi2/dof |"
    yield "|---|---|---|---|---|"
    for recording in recordings:
        source = open_source([recording], SourceConfig(), SimulationConfig())
        graph = slam(list(source), "pose_graph").pose_graph
        if graph is None:
            continue
        for kind, (count, chi2, dof) in chi2_by_kind(graph).items():
            ratio = f"{chi2 / dof:.4g}" if dof > 0.5 else "-"
            yield f"| {recording.name} | {kind} | {count} | {dof:.0f} | {ratio} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("worlds", "graphs"))
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--backend", default="pose_graph")
    parser.add_argument("--worlds", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    worlds = given.what == "worlds"
    rows = world_rows(given.backend, given.worlds, given.seed) if worlds else None
    for row in rows or graph_rows(given.recordings):
        print(row, flush=True)


if __name__ == "__main__":
    main()
