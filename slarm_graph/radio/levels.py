# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Received levels and their standard deviation from a predicted or measured radio-map file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.files import read_radio_npz
from slarm_graph.radio.measured.files import read_measured_npz
from slarm_graph.radio.path_loss import shadow_sigma_db

Layers = NDArray[np.float32]

PREDICTED, MEASURED = "radio_map.npz", "measured_radio_map.npz"
"""File names in a run folder."""


@dataclass(frozen=True, slots=True)
class LevelMap:
    """Expected received levels.

    Parameters
    ----------
    geometry : GridGeometry
    names : tuple of str, length A
        Of the access points.
    level_dbm : (A, rows, cols) float32
        nan where there is none.
    sd_db : (A, rows, cols) float32
        Standard deviation: of the mean where measured, of shadow fading where predicted.
    measured : bool
    """

    geometry: GridGeometry
    names: tuple[str, ...]
    level_dbm: Layers
    sd_db: Layers
    measured: bool


def levels_file(place: Path) -> Path:
    """Return the radio map of a run folder, the predicted one where there are two; or the file."""
    if not place.is_dir():
        return place
    found = [place / name for name in (PREDICTED, MEASURED) if (place / name).is_file()]
    return found[0] if found else place / PREDICTED


def is_measured(place: Path) -> bool:
    """Whether a file, or a run folder's radio map, is a measured one."""
    try:
        with np.load(levels_file(place), allow_pickle=False) as archive:
            return "mean_dbm" in archive.files
    except (OSError, ValueError):
        return False


def read_levels(place: Path) -> LevelMap:
    """Read levels from a radio map's file or a run folder.

    Raises
    ------
    BadInput
        When it is neither a predicted nor a measured map.
    """
    path = levels_file(place)
    if is_measured(path):
        made = read_measured_npz(path)
        names = tuple(ap.name for ap in made.access_points)
        return LevelMap(made.geometry, names, made.mean_dbm, made.mean_sd_db, measured=True)
    radio = read_radio_npz(path)
    names = tuple(ap.name for ap in radio.access_points)
    sigma = shadow_sigma_db(radio.line_of_sight, radio.scenario).astype(np.float32)
    return LevelMap(radio.geometry, names, radio.rss_dbm, sigma, measured=False)


def common_names(reference: LevelMap, estimate: LevelMap) -> tuple[str, ...]:
    """Return the access points that both maps have.

    Raises
    ------
    BadInput
        When there is none.
    """
    both = tuple(name for name in reference.names if name in estimate.names)
    if not both:
        raise BadInput(
            f"no access point is in both maps: {', '.join(reference.names)} and"
            f" {', '.join(estimate.names)}"
        )
    return both
