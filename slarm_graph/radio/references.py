# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read a radio map to evaluate, and its reference: another map, or a world's true radio map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.config import RadioConfig
from slarm_graph.files.coverage import read_coverage
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import Mask
from slarm_graph.radio.files import read_radio_npz
from slarm_graph.radio.levels import PREDICTED
from slarm_graph.radio.radio_map import theoretical_radio_map
from slarm_graph.truth_map import truth_map

Extent = tuple[float, float, float, float]

_COVERAGE = "coverage.npz"


def read_estimate(place: Path) -> tuple[RadioMap, Path]:
    """Read a run folder's radio map, or a file; also return the folder it lies in."""
    path = place / PREDICTED if place.is_dir() else place
    return read_radio_npz(path), path.parent


def has_coverage(folder: Path) -> bool:
    """Whether a run folder has the file of accessible cells."""
    return (folder / _COVERAGE).is_file()


def geographic_of(radio: RadioMap, folder: Path) -> GeographicMap:
    """Return the run's geographic map; without one, cells with a gain count as accessible."""
    if has_coverage(folder):
        return read_coverage(folder / _COVERAGE)
    known: Mask = np.asarray(np.isfinite(radio.path_loss_db).any(axis=0))
    states = np.where(known, CellState.ACCESSIBLE, CellState.UNKNOWN).astype(np.uint8)
    heights = np.zeros(states.shape, dtype=np.float32)
    layers = Coverage(known, known, known)
    return GeographicMap(radio.geometry, states, heights, radio.height_source, layers)


def names_world(place: str) -> bool:
    """Whether a reference is a world: a shipped one, or a YAML file."""
    return place in shipped_worlds() or Path(place).suffix in (".yaml", ".yml")


def reference_for(place: str, estimate: RadioMap) -> tuple[Mask, RadioMap, Extent | None]:
    """Return truly accessible cells, the true radio map, and the extent of the true space [m].

    Parameters
    ----------
    place : str
        A radio map file, or a world, whose theoretical radio map is made at the estimate's
        resolution and with its radio parameters.
    estimate : RadioMap
    """
    if not names_world(place):
        radio, folder = read_estimate(Path(place))
        return geographic_of(radio, folder).accessible, radio, None
    world = load_world(place)
    truth = truth_map(world, estimate.geometry.resolution_m)
    config = RadioConfig(
        scenario=estimate.scenario,
        antenna_height_m=estimate.antenna_height_m,
        rician_factor_db=estimate.rician_factor_db,
    )
    radio = theoretical_radio_map(world, truth.geometry, config)
    return truth.reachable, radio, world.extent_m()
