# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Mean function of the Gaussian process: a multi-wall propagation model, linear in what is fitted.

    rss = level at 1 m - n 10 log10(d) - wall loss * walls - excess loss of each block over a wall
          + terms of the reading

The terms of the reading are the antenna pattern about the robot's body, and the offset of each
further noise class; they belong to the receiver, not to the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.blocks import Blocks
from slarm_graph.radio.measured.posterior import Coefficients
from slarm_graph.radio.measured.readings import RssReadings
from slarm_graph.radio.propagation.crossings import (
    LinkCrossings,
    crossings_by_height,
    link_crossings,
)
from slarm_graph.radio.propagation.models import decades_of_distance

MAP_TERMS = ("level_at_1_m_dbm", "exponent", "wall_db")
"""Coefficients of the map itself."""

_PRIOR = ((-40.0, 25.0), (2.0, 0.7), (5.0, 4.0))
"""Mean and standard deviation of the map's terms: 0 dBm and Friis's first metre at 2.4 GHz, widely;
exponents of 1.6 to 3.5 indoors (Rappaport, Table 4.2); walls of 3 to 7 dB (COST 231)."""

_BLOCK_SD_DB = 3.5
"""Prior standard deviation of a block's excess loss: whether it is solid or hollow between two
walls was not seen. One more wall of the prior's 5 dB in half of them is 3.5 dB about none."""

_FACES_OFF_CELLS = 1
"""Position error of wall faces on a map: they are rounded to cells, and recovered to about one.
Half makes wall losses 0.6 dB less on the world dead_ends, double 0.2 dB more; without it they are
2.1 dB too low there."""

_PATTERN_SD_DB = 1.5
"""Prior of the antenna pattern's first harmonic, of a small antenna on a body; halving or doubling
it moves nothing once some hundred readings are in."""

_CLASS_SD_DB = 2.0
"""Prior of the offset between single packets and means of several: the fading's skew."""

_DB_PER_DECADE_TO_SLOPE = 10.0 / np.log(10.0)
"""d/dx of 10 log10 x."""


@dataclass(frozen=True, slots=True)
class MeanFunction:
    """Mean function over a map for one access point.

    Parameters
    ----------
    geographic : GeographicMap
        Its heights decide which walls a link passes.
    access_point : AccessPoint or None
        None where its position is unknown: the mean is then a level alone.
    antenna_height_m, mount_radius_m : float
        As in `RadioConfig`.
    blocks : Blocks, optional
        Obstacles with an excess loss of their own; without them they count as other walls.
    face_error_cells : int
        Position error of wall faces on the map; 0 takes them for certain.
    """

    geographic: GeographicMap
    access_point: AccessPoint | None
    antenna_height_m: float
    mount_radius_m: float
    blocks: Blocks | None = None
    face_error_cells: int = _FACES_OFF_CELLS

    @property
    def terms(self) -> int:
        """Number of the map's own coefficients."""
        if self.access_point is None:
            return 1
        return len(MAP_TERMS) + (self.blocks.count if self.blocks is not None else 0)

    def link_crossings(self, points_m: Floats) -> LinkCrossings:
        """Return the walls and blocks that links to points (N, 2) [m] pass."""
        assert self.access_point is not None
        return link_crossings(
            self.geographic.geometry,
            self.geographic.heights_m,
            self.access_point.position_m(),
            points_m,
            self.antenna_height_m,
            mount_radius_m=self.mount_radius_m,
            shift_cells=self.face_error_cells,
            insides=None if self.blocks is None else self.blocks.insides,
        )

    def map_design(self, points_m: Floats) -> Floats:
        """Return the design (N, terms) of the expected level at points (N, 2) [m]."""
        return self.map_design_and_variance(points_m)[0]

    def map_design_and_variance(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Return that design, and the variance (N,) of the level by wall position error [dB^2].

        A wall's edge that is off by a cell gives links beside it a wall too many or too few, all
        to one side: without this variance, wall losses are underestimated, and overconfident.
        """
        level = np.ones((len(points_m), 1))
        if self.access_point is None:
            return level, np.zeros(len(points_m))
        passed = self.link_crossings(points_m)
        design = self._passing(points_m, self.access_point.position_m(), passed.counts.mean(axis=0))
        map_variance_db2 = _PRIOR[2][0] ** 2 * passed.counts.var(axis=0)
        return np.column_stack([design, -passed.through.astype(float)]), map_variance_db2

    def _passing(self, points_m: Floats, positions_m: Floats, walls: Floats) -> Floats:
        """Design (..., N, 3) for points, positions (..., 3) and numbers of walls (..., N)."""
        decades = decades_of_distance(self._distance_m(points_m, positions_m))
        return np.stack([np.ones(decades.shape), -decades, -walls], axis=-1)

    def reading_design_and_variance(self, readings: RssReadings) -> tuple[Floats, Floats]:
        """Return the design (N, p) of readings: the map's terms, then those of the reading.

        And the variance (N,) [dB^2] of `map_design_and_variance`.
        """
        design, map_variance_db2 = self.map_design_and_variance(readings.points_m)
        return np.column_stack([design, self._own(readings, self._position_m())]), map_variance_db2

    def reading_designs_from(self, readings: RssReadings, positions_m: Floats) -> Floats:
        """Return the designs (P, N, p) of readings for positions (P, 3) of the access point [m].

        On the map without shifts, and without excess losses of blocks.
        """
        plans_m, plan = np.unique(positions_m[:, :2], axis=0, return_inverse=True)
        heights_m, height = np.unique(positions_m[:, 2], return_inverse=True)
        walls = crossings_by_height(
            self.geographic.geometry,
            self.geographic.heights_m,
            plans_m,
            heights_m,
            readings.points_m,
            self.antenna_height_m,
            mount_radius_m=self.mount_radius_m,
        )[plan.ravel(), height]
        design = self._passing(readings.points_m, positions_m, walls.astype(np.float64))
        return np.concatenate([design, self._own(readings, positions_m)], axis=-1)

    def _position_m(self) -> Floats | None:
        return None if self.access_point is None else self.access_point.position_m()

    def _own(self, readings: RssReadings, positions_m: Floats | None) -> Floats:
        """Terms of readings (..., N, q), for positions (..., 3) of the access point if known."""
        own = np.equal.outer(readings.noise_class, np.arange(1, readings.classes)).astype(
            np.float64
        )
        if positions_m is None:
            return own
        own = np.broadcast_to(own, (*positions_m.shape[:-1], *own.shape))
        if readings.headings_rad is None:
            return own
        toward = positions_m[..., None, :2] - readings.points_m
        bearing = np.arctan2(toward[..., 1], toward[..., 0]) - readings.headings_rad
        pattern = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
        return np.concatenate([own, pattern], axis=-1)

    def coefficients(self, readings: RssReadings) -> Coefficients:
        """Return the prior of the design's coefficients."""
        own = self._own(readings.only(np.arange(0)), self._position_m()).shape[1]
        classes = readings.classes - 1
        sds = [_CLASS_SD_DB] * classes + [_PATTERN_SD_DB] * (own - classes)
        blocks = [(0.0, _BLOCK_SD_DB)] * (self.terms - len(MAP_TERMS))
        prior = [*_PRIOR[: self.terms], *blocks, *((0.0, sd) for sd in sds)]
        middle, spread = np.array(prior, dtype=np.float64).T
        return Coefficients(middle, spread)

    def distance_slope_db_m(self, points_m: Floats) -> Floats:
        """Return the gradient of the expected level at points (N, 2) [dB/m], by the prior's n."""
        if self.access_point is None:
            return np.zeros(len(points_m))
        distance_m = self._distance_m(points_m, self.access_point.position_m())
        return np.asarray(_PRIOR[1][0] * _DB_PER_DECADE_TO_SLOPE / np.maximum(distance_m, 1e-2))

    def _distance_m(self, points_m: Floats, positions_m: Floats) -> Floats:
        """Length (..., N) of the links from positions (..., 3) [m]."""
        flat_m = np.linalg.norm(points_m - positions_m[..., None, :2], axis=-1)
        return np.asarray(np.hypot(flat_m, positions_m[..., None, 2] - self.antenna_height_m))
