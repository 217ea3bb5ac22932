# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Geometry of radio links, the input of a propagation model, and the seam of such models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask


@dataclass(frozen=True, slots=True)
class Links:
    """Links from one access point to N antennas.

    Parameters
    ----------
    access_point_m : (3,) float64
        x, y in the map, z above the floor [m].
    points_m : (N, 2) float64
        The antennas in plan [m].
    distance_m : (N,) float64
        **3D** distance [m].
    line_of_sight : (N,) bool
    crossings : (N,) int16
        Walls and obstacles that the straight segment passes (`wall_crossings`).
    frequency_hz : float
    antenna_height_m : float
    """

    access_point_m: Floats
    points_m: Floats
    distance_m: Floats
    line_of_sight: Mask
    crossings: NDArray[np.int16]
    frequency_hz: float
    antenna_height_m: float

    def __len__(self) -> int:
        return len(self.distance_m)


@dataclass(frozen=True, slots=True)
class PathLoss:
    """Path loss of N links by a propagation model.

    Parameters
    ----------
    loss_db : (N,) float64
        Expected path loss [dB].
    shadowing_sigma_db : (N,) float64
        Standard deviation of the shadow fading about it [dB].
    """

    loss_db: Floats
    shadowing_sigma_db: Floats


class PropagationModel(Protocol):
    """A path-loss model; built from its settings, and found by name in the registry of parts."""

    def path_loss_db(self, links: Links) -> PathLoss:
        """Return expected loss and shadow fading of links.

        Raises
        ------
        BadInput
            When the model does not hold for them.
        """
        ...
