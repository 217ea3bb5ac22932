# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The mean of the field: a multi-wall propagation model that is linear in what is fitted.

    rss = level at 1 m - n 10 log10(d) - wall loss * walls + the reading's own terms

The reading's own terms are the pattern of the robot's antenna about its body, and the offset of
each further class of readings; they belong to how it was heard, not to the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.posterior import Coefficients
from slarm_graph.radio.measured.readings import Placed
from slarm_graph.radio.propagation.links import Links
from slarm_graph.radio.propagation.models import decades_of_distance
from slarm_graph.radio.propagation.over_map import links_to

MAP_TERMS = ("level_at_1_m_dbm", "exponent", "wall_db")
"""What is fitted of the map itself."""

_PRIOR = ((-40.0, 25.0), (2.0, 0.7), (5.0, 4.0))
"""Mean and standard deviation of the map's terms: 0 dBm and Friis's first metre at 2.4 GHz, widely;
exponents of 1.6 to 3.5 indoors (Rappaport, Table 4.2); walls of 3 to 7 dB (COST 231)."""

_PATTERN_SD_DB = 1.5
"""Of the first harmonic of a small antenna on a body; halving or doubling it moves nothing once
some hundred readings are in."""

_CLASS_SD_DB = 2.0
"""Of the offset between single packets and means of several, which differ by the fading's skew."""

_DB_PER_DECADE_TO_SLOPE = 10.0 / np.log(10.0)
"""d/dx of 10 log10 x."""


@dataclass(frozen=True, slots=True)
class Mean:
    """The mean over a map for one access point.

    Parameters
    ----------
    geographic : GeographicMap
        Its heights say what a link passes.
    access_point : AccessPoint or None
        None where its position is unknown: the mean is then a level alone.
    antenna_height_m, mount_radius_m : float
        As in `RadioConfig`.
    """

    geographic: GeographicMap
    access_point: AccessPoint | None
    antenna_height_m: float
    mount_radius_m: float

    @property
    def terms(self) -> int:
        """Number of the map's own coefficients."""
        return len(MAP_TERMS) if self.access_point is not None else 1

    def links(self, points_m: Floats) -> Links:
        """Return the links to points (N, 2) [m]."""
        assert self.access_point is not None
        return links_to(
            self.geographic.geometry,
            self.geographic.heights_m,
            self.access_point,
            points_m,
            antenna_height_m=self.antenna_height_m,
            mount_radius_m=self.mount_radius_m,
        )

    def of_map(self, points_m: Floats) -> Floats:
        """Return the design (N, terms) of the expected level at points (N, 2) [m]."""
        level = np.ones((len(points_m), 1))
        if self.access_point is None:
            return level
        links = self.links(points_m)
        decades = decades_of_distance(links.distance_m)
        return np.column_stack([level, -decades, -links.crossings.astype(np.float64)])

    def of_readings(self, placed: Placed) -> Floats:
        """Return the design (N, p) of readings: the map's terms, then their own."""
        return np.column_stack([self.of_map(placed.points_m), self._own(placed)])

    def _own(self, placed: Placed) -> Floats:
        columns = [placed.noise_class == k for k in range(1, placed.classes)]
        own = np.array(columns, dtype=np.float64).reshape(placed.classes - 1, len(placed)).T
        if placed.headings_rad is None or self.access_point is None:
            return own
        toward = self.access_point.position_m()[:2] - placed.points_m
        bearing = np.arctan2(toward[:, 1], toward[:, 0]) - placed.headings_rad
        return np.column_stack([own, np.cos(bearing), np.sin(bearing)])

    def coefficients(self, placed: Placed) -> Coefficients:
        """Return the prior of the design's coefficients."""
        own = self._own(placed.only(np.arange(0))).shape[1]
        classes = placed.classes - 1
        sds = [_CLASS_SD_DB] * classes + [_PATTERN_SD_DB] * (own - classes)
        prior = [*_PRIOR[: self.terms], *((0.0, sd) for sd in sds)]
        middle, spread = np.array(prior, dtype=np.float64).T
        return Coefficients(middle, spread)

    def slope_db_m(self, points_m: Floats) -> Floats:
        """Return how steep the expected level is at points (N, 2) [dB/m], by the prior's n."""
        if self.access_point is None:
            return np.zeros(len(points_m))
        distance_m = np.maximum(self.links(points_m).distance_m, 1e-2)
        return np.asarray(_PRIOR[1][0] * _DB_PER_DECADE_TO_SLOPE / distance_m)
