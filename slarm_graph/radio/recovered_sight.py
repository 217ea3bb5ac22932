# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line of sight in a recovered map: clear, blocked, as likely as heights allow, or unknown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from slarm_graph.config import RadioConfig
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains, edges_m
from slarm_graph.radio.line_of_sight import (
    line_of_sight_over_cells,
    line_of_sight_past_cells,
    line_of_sight_past_solids,
    line_of_sight_to_points,
)
from slarm_graph.raster.fill import inside_solids
from slarm_graph.raster.segments import cells_passed
from slarm_graph.world import Solid

_GAP_M = 0.36
"""Width of the robot of the paper's room: what is narrower is no way in."""
_MOUNT_STEP_M = 0.001
"""A millimetre: walls are known to about a centimetre."""


@dataclass(frozen=True, slots=True)
class RecoveredSight:
    """Of one access point.

    Parameters
    ----------
    probability : (rows, cols) float64
        That nothing known hides the antenna; 0 or 1 where heights are certain.
    unknown : (rows, cols) bool
        Links that pass cells nobody has seen, and that nothing known hides for certain.
    """

    probability: Floats
    unknown: Mask


def recovered_sight(
    geographic: GeographicMap, free: Mask, position_m: Floats, config: RadioConfig
) -> RecoveredSight:
    """Decide on the map's solids where it has any, else on its cells.

    Solids of uncertain height stand in groups that are low or high together; the groups are
    independent of each other.

    Parameters
    ----------
    geographic : GeographicMap
    free : (rows, cols) bool
        Cells in which an antenna can be.
    position_m : (3,)
        Of the access point [m].
    config : RadioConfig
    """
    if geographic.solids:
        probability = _past_solids(geographic, free, position_m, config)
    else:
        probability = line_of_sight_over_cells(
            geographic.geometry,
            geographic.heights_m,
            position_m,
            config.antenna_height_m,
            mount_radius_m=config.mount_radius_m,
        ).astype(np.float64)
    unknown = _past_unseen(geographic, position_m, config) & (probability > 0.0)
    return RecoveredSight(probability, unknown)


def _past_solids(
    geographic: GeographicMap, free: Mask, position_m: Floats, config: RadioConfig
) -> Floats:
    """Probability of line of sight (rows, cols) past certain and uncertain solids."""
    on_face = free & inside_solids(geographic.geometry, geographic.solids)
    position_m = _on_room_side(geographic, free & ~on_face, position_m, config.mount_radius_m)
    unsure = {n for group in geographic.height_groups for n in group.solids}
    sure = [s for n, s in enumerate(geographic.solids) if n not in unsure]

    def clear(solids: Sequence[Solid]) -> Mask:
        """Line of sight (rows, cols) past some of the solids."""
        return _clear_of(geographic, on_face, solids, position_m, config.antenna_height_m)

    probability = clear(sure).astype(np.float64)
    for group in geographic.height_groups:
        solids = [geographic.solids[n] for n in group.solids]
        share, before = np.zeros(probability.shape), None
        for levels_m in _effective(group.levels_m, position_m[2], config.antenna_height_m):
            if before is None or not np.array_equal(levels_m, before[0]):
                high = [replace(s, height_m=h) for s, h in zip(solids, levels_m, strict=True)]
                before = (levels_m, clear(high))
            share += before[1]
        probability *= share / len(group.levels_m)
    return probability


def _effective(levels_m: Floats, access_point_m: float, antenna_m: float) -> Floats:
    """Levels (K, N) between which a link can tell: all above both ends are alike, all below too."""
    low, high = sorted((access_point_m, antenna_m))
    return np.where(levels_m >= high, np.inf, np.where(levels_m <= low, 0.0, levels_m))


def _clear_of(
    geographic: GeographicMap,
    on_face: Mask,
    solids: Sequence[Solid],
    position_m: Floats,
    antenna_height_m: float,
) -> Mask:
    """Line of sight (rows, cols) past some of the map's solids."""
    geometry = geographic.geometry
    standing = [solid for solid in solids if solid.height_m > 0.0]
    clear = line_of_sight_past_solids(geometry, standing, position_m, antenna_height_m)
    # The centre of a free cell on a wall's face may come to lie a little inside the wall.
    if on_face.any():
        points = geometry.center_of(np.argwhere(on_face))
        clear[on_face] = line_of_sight_to_points(points, standing, position_m, antenna_height_m)
    return clear


def unseen_pockets(geographic: GeographicMap) -> Mask:
    """Cells (rows, cols) nobody has seen, in pockets with an open border to what is free.

    What walls enclose has the walls' height; behind an open border there may be anything. Gaps
    narrower than a robot are places where a wall was not hit, not ways in.
    """
    states, geometry = geographic.states, geographic.geometry
    free = np.isin(states, (CellState.ACCESSIBLE, CellState.EXPANSION, CellState.ENCLOSED))
    pockets, _ = ndimage.label(states == CellState.UNKNOWN)
    around = np.ones((3, 3))
    # A wall one cell deep has holes where its face lies on centres, none without wall beside it.
    wall = (states == CellState.OBSTACLE) | _outlined(geometry, geographic.solids)
    near_wall = ndimage.binary_dilation(wall, around)
    border = ndimage.binary_dilation(free) & (pockets > 0) & ~near_wall
    gaps, count = ndimage.label(border, around)
    wide = np.bincount(gaps.ravel(), minlength=count + 1) * geometry.resolution_m >= _GAP_M
    wide[0] = False
    return np.asarray(np.isin(pockets, np.unique(pockets[wide[gaps]])) & (pockets > 0))


def _outlined(geometry: GridGeometry, solids: Sequence[Solid]) -> Mask:
    """Cells (rows, cols) that an edge of a solid passes."""
    passed = np.zeros(geometry.shape, dtype=np.bool_)
    if solids:
        edges = np.concatenate([edges_m(solid.corners_m) for solid in solids])
        origin = (geometry.origin_x_m, geometry.origin_y_m) * 2
        _, cells = cells_passed((edges - origin) / geometry.resolution_m, geometry.shape, 0.0)
        passed.flat[cells] = True
    return passed


def _past_unseen(geographic: GeographicMap, position_m: Floats, config: RadioConfig) -> Mask:
    """Links (rows, cols) that pass unseen cells at whatever height: nobody knows if clear."""
    unseen = unseen_pockets(geographic)
    if not unseen.any():
        return unseen
    return ~line_of_sight_past_cells(
        geographic.geometry,
        unseen,
        position_m,
        config.antenna_height_m,
        mount_radius_m=config.mount_radius_m,
    )


def _on_room_side(
    geographic: GeographicMap, free: Mask, position_m: Floats, radius_m: float
) -> Floats:
    """Move an access point that a recovered wall has swallowed to the wall's face in the room.

    Walls are recovered thinner than they are and a few centimetres off, so that a point mounted on
    one may lie nearer to its back, or behind it. The nearest free cell before it tells the side
    it serves.
    """
    geometry, plan = geographic.geometry, position_m[:2]
    reach_m = radius_m + geometry.resolution_m
    low = np.maximum(geometry.cell_of(plan - reach_m), 0)
    high = np.maximum(geometry.cell_of(plan + reach_m) + 1, 0)
    cells = geometry.center_of(np.argwhere(free[low[0] : high[0], low[1] : high[1]]) + low)
    away_m = np.linalg.norm(cells - plan, axis=1)
    if not len(cells) or away_m.min() > reach_m:
        return position_m
    way = cells[away_m.argmin()] - plan
    steps = math.ceil(float(away_m.min()) / _MOUNT_STEP_M)
    points = plan + np.linspace(0.0, 1.0, steps + 1)[:, None] * way
    hidden = np.zeros(len(points), dtype=np.bool_)
    for solid in geographic.solids:
        if solid.height_m > position_m[2]:
            hidden |= contains(solid.corners_m, points)
    if not hidden.any():
        return position_m
    face = points[min(int(np.flatnonzero(hidden)[-1]) + 1, steps)]
    return np.array([*face, position_m[2]])
