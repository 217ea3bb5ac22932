# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What half and double of a constant do to the metrics.

    python benchmarks/sensitivity.py slarm_graph.recovery.wall_lines:_BAND_CELLS
    python benchmarks/sensitivity.py --drive slarm_graph.exploration.frontier:_STRIP_M

Constants of recovery and radio map are judged on one drive through every world, from which only the
maps are made anew. With `--drive` every value drives for itself; with `--recording` it runs over a
recording. A line says which metrics change, from -> to; one that says nothing changed nothing. Only
constants that Python code reads can be judged so: kernels have theirs compiled in.
"""

from __future__ import annotations

import argparse
import importlib
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from slarm_graph.app.explore import explore_world
from slarm_graph.app.job import Job, Run
from slarm_graph.app.pipeline import run
from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.app.world_accuracy import accuracy_metrics
from slarm_graph.config import RunConfig, SimulationConfig
from slarm_graph.config.driving import WheelConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.geographic import GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.propagation.over_map import predicted_radio_map
from slarm_graph.recovery.recover import recover_scans, with_sizes_of
from slarm_graph.world import WorldMap

Figures = dict[str, float]

SHOWN = (
    *("accuracy", "gain_hit", "los_agreement", "gain_rmse_db", "iou", "ate_rmse_m"),
    *("coverage_observed", "coverage_footprint", "path_length_m", "drive_time_s", "turns"),
    *("relations_translation_m", "relations_rotation_deg", "wall_sigma_m", "map_entropy_nat"),
)
SMALLEST_SHARE = 0.002
"""Changes of less than 0.2 % of a metric are rounding or luck and not shown."""


def explored(world: WorldMap, config: RunConfig) -> Run:
    """Drive through a world, in a folder that is thrown away."""
    with tempfile.TemporaryDirectory() as out:
        return explore_world(world, config, create_run_folder(Path(out), "run"), Quiet())


def figures_of(run_done: Run) -> Figures:
    """Name and value of every metric."""
    return {metric.name: float(metric.value) for metric in run_done.metrics}


def maps_of(done: Run, world: WorldMap, config: RunConfig) -> Figures:
    """Make the maps of a drive anew and judge them."""
    geographic: GeographicMap = recover_scans(
        done.log.scans,
        done.slam.trajectory,
        config.mapping,
        with_sizes_of(world, config.recovery),
        geometry=GridGeometry.covering(*world.extent_m(), config.explore.resolution_m),
    )
    radio = predicted_radio_map(geographic, world.access_points, config)
    metrics = accuracy_metrics(world, geographic, radio, config.radio, config.explore.area)
    return {metric.name: float(metric.value) for metric in metrics}


@contextmanager
def set_to(place: str, value: object) -> Iterator[None]:
    """Give a constant, `module:name`, another value for a while."""
    module_name, name = place.split(":")
    module = importlib.import_module(module_name)
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def times(place: str, factor: float) -> object:
    """Value of a constant times a factor; whole numbers stay whole and above zero."""
    module_name, name = place.split(":")
    value = getattr(importlib.import_module(module_name), name)
    if isinstance(value, int):
        return max(1, round(value * factor))
    if isinstance(value, tuple):
        return tuple(part * factor for part in value)
    return value * factor


def changes(before: Figures, after: Figures) -> str:
    """Say which of the metrics shown differ by more than rounding."""
    told = [
        f"{name} {before[name]:.4g} -> {after[name]:.4g}"
        for name in SHOWN
        if name in before
        and abs(after[name] - before[name]) > SMALLEST_SHARE * max(abs(before[name]), 1e-9)
    ]
    return ", ".join(told) or "nothing"


def judged(place: str, name: str, measure: Callable[[], Figures], usual: Figures) -> None:
    """Print what half and double of a constant do."""
    for label, factor in (("half", 0.5), ("double", 2.0)):
        with set_to(place, times(place, factor)):
            print(f"{place} {label} ({name}): {changes(usual, measure())}", flush=True)


def main() -> None:
    """Judge every constant named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("constants", nargs="+", metavar="MODULE:NAME")
    parser.add_argument("--drive", action="store_true", help="drive anew for every value")
    parser.add_argument("--recording", type=Path, help="run over a recording instead")
    parser.add_argument("--worlds", default="paper_room,cluttered")
    parser.add_argument("--backend", default="odometry")
    given = parser.parse_args()
    # Without slip the maps of an exact drive are exact, and show what only the constant does.
    wheels = WheelConfig(
        wheel_base_error=0.0, left_slip=0.0, right_slip=0.0, random_slip_m_per_sqrt_m=0.0
    )
    exact = SimulationConfig() if given.drive else SimulationConfig(wheels=wheels)
    config = RunConfig(backend=given.backend, simulation=exact)
    if given.recording:
        job = Job((given.recording,), config, (), None, given.recording.with_suffix(".relations"))

        def whole_run() -> Figures:
            """Run over the recording."""
            with tempfile.TemporaryDirectory() as out:
                return figures_of(run(job, create_run_folder(Path(out), "run"), Quiet()))

        usual = whole_run()
        for place in given.constants:
            judged(place, given.recording.stem, whole_run, usual)
        return
    for name in given.worlds.split(","):
        world = load_world(name)
        done = explored(world, config)
        usual = figures_of(done) if given.drive else maps_of(done, world, config)
        for place in given.constants:

            def measure(world: WorldMap = world, done: Run = done) -> Figures:
                """Drive, or only map, with the constant as it is now."""
                if given.drive:
                    return figures_of(explored(world, config))
                return maps_of(done, world, config)

            judged(place, name, measure, usual)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
