# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One closed loop in the paper's room, from the first reading to its accuracy."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from slarm_graph import backends
from slarm_graph.access_points import RadioMap
from slarm_graph.app.truth import FINE_M, accuracy_on
from slarm_graph.backend import silent
from slarm_graph.config import DrivingConfig, ExploreConfig, RunConfig
from slarm_graph.eval.association import associate
from slarm_graph.exploration import explorers
from slarm_graph.exploration.closed_loop import Exploration, explore
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.simulation.worlds import make_world
from slarm_graph.geographic import GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.propagation.over_map import predicted_radio_map
from slarm_graph.recovery.recover import recover_scans, with_sizes_of
from slarm_graph.world import WorldMap

PAPER_ROOM: Final = "paper_room"


@dataclass(frozen=True, slots=True)
class RoomTrial:
    """One closed loop."""

    backend: str
    resolution_m: float
    speed_m_s: float
    seed: int
    explorer: str = "ggmr+"
    goal: Literal["observed", "footprint"] = "observed"

    def config(self) -> RunConfig:
        """Return the configuration of the run."""
        driving = DrivingConfig(speed_m_s=self.speed_m_s)
        return RunConfig(
            backend=self.backend,
            seed=self.seed,
            explore=ExploreConfig(
                explorer=self.explorer,
                resolution_m=self.resolution_m,
                driving=driving,
            ),
            **{"ggmr+": {"goal": self.goal}},
        )


@dataclass(frozen=True, slots=True)
class Row:
    """What one trial came to; shares from 0 to 1.

    `accuracy_ring` is the accuracy with the paper's preset, an expansion radius of one cell.
    """

    backend: str
    resolution_m: float
    speed_m_s: float
    seed: int
    accuracy: float
    accuracy_ring: float
    accuracy_area: float
    false_accessible: float
    iou: float
    gain_hit: float
    gain_rmse_db: float
    coverage_observed: float
    coverage_visited: float
    coverage_footprint: float
    ate_rmse_m: float
    path_length_m: float
    turns: int
    drive_time_s: float
    collisions: int
    cpu_s: float


@dataclass(frozen=True, slots=True)
class Maps:
    """The maps of one trial."""

    geographic: GeographicMap
    radio: RadioMap


def run_trial(trial: RoomTrial) -> tuple[Row, RadioMap]:
    """Drive one closed loop and measure it; its radio map comes along."""
    began = time.process_time()
    world, config = load_world(PAPER_ROOM), trial.config()
    drive = driven(world, config)
    maps = recovered(world, drive, config)
    radius_m = trial.resolution_m
    ring_config = config.model_copy(
        update={"recovery": config.recovery.model_copy(update={"expansion_radius_m": radius_m})}
    )
    ring = recovered(world, drive, ring_config)
    result = accuracy_on(world, maps.geographic, maps.radio, config.radio, trial.resolution_m)
    pairs = associate(drive.truth, drive.trajectory)
    apart_m = np.linalg.norm(pairs.reference[:, :2] - pairs.estimate[:, :2], axis=1)
    row = Row(
        trial.backend,
        trial.resolution_m,
        trial.speed_m_s,
        trial.seed,
        result.accuracy,
        accuracy_on(world, ring.geographic, ring.radio, config.radio, trial.resolution_m).accuracy,
        accuracy_on(world, maps.geographic, maps.radio, config.radio, FINE_M).accuracy,
        result.false_accessible,
        result.iou,
        result.gain_hit,
        result.gain_rmse_db,
        result.coverage_observed,
        result.coverage_visited,
        result.coverage_footprint,
        float(np.sqrt(np.mean(apart_m**2))),
        drive.report.path_length_m,
        drive.report.turns,
        drive.report.drive_time_s,
        drive.report.collisions,
        time.process_time() - began,
    )
    return row, maps.radio


def recovered(world: WorldMap, drive: Exploration, config: RunConfig) -> Maps:
    """Return the geographic and the radio map of a drive, in the world's frame."""
    geometry = GridGeometry.covering(*world.extent_m(), config.explore.resolution_m)
    geographic = recover_scans(
        drive.log.scans,
        drive.trajectory,
        config.mapping,
        with_sizes_of(world, config.recovery),
        geometry=geometry,
    )
    return Maps(geographic, predicted_radio_map(geographic, world.access_points, config))


def driven(world: WorldMap, config: RunConfig) -> Exploration:
    """Let a robot find the world out."""
    for_world, for_backend = np.random.default_rng(config.seed).spawn(2)
    return explore(
        make_world(world, config.simulation, for_world),
        backends.make(config.backend, config, for_backend, silent),
        explorers.make(config),
        config.explore,
        extent_m=world.extent_m(),
        start=world.start,
        mapping=config.mapping,
    )
