# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line of sight on a recovered map: its probability, and links through unobserved space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import RadioConfig
from slarm_graph.geographic import CellState, GeographicMap, is_free
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains, edges_m
from slarm_graph.radio.line_of_sight import (
    line_of_sight_over_cells,
    line_of_sight_past_cells,
    line_of_sight_past_solids,
    line_of_sight_to_points,
    moved_to_faces,
)
from slarm_graph.radio.line_of_sight_probability import (
    multiply_by_group_probabilities,
    split_by_certainty,
)
from slarm_graph.raster.bands import by_windows, cells_of, windows
from slarm_graph.raster.fill import Polygons
from slarm_graph.raster.layers import new_layer, set_aside
from slarm_graph.raster.patches import joined, larger_than
from slarm_graph.raster.segments import cells_passed
from slarm_graph.tiles import Where, Window
from slarm_graph.world import Solid

_GAP_M = 0.36
"""Width of the robot of the paper's room: a narrower gap is no entrance."""
_MOUNT_STEP_M = 0.001
"""Step along the line to a wall's face, a millimetre: walls are known to about a centimetre."""

_AROUND, _SIDES = np.ones((3, 3), np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


@dataclass(frozen=True, slots=True)
class RecoveredLineOfSight:
    """Line of sight to one access point.

    Parameters
    ----------
    probability : (rows, cols) float32
        That no known obstacle hides the antenna; 0 or 1 where heights are certain, 0 where no
        antenna can be.
    unknown : (rows, cols) bool
        Links through unobserved cells that no known obstacle certainly hides.
    """

    probability: NDArray[np.float32]
    unknown: Mask


def recovered_line_of_sight(
    geographic: GeographicMap, free: Mask, position_m: Floats, config: RadioConfig
) -> RecoveredLineOfSight:
    """Compute the line of sight past the map's solids where it has any, else past its cells.

    Solids of uncertain height form groups that are low or high together; the groups are
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
        clear = line_of_sight_over_cells(
            geographic.geometry,
            geographic.heights_m,
            position_m,
            config.antenna_height_m,
            mount_radius_m=config.mount_radius_m,
            where=geographic.where,
        )
        where = geographic.where
        seen = by_windows(where, 0, lambda window: clear[window] & free[window])
        probability = _certain(seen, where)
    asked = by_windows(geographic.where, 0, lambda window: probability[window] > 0.0)
    set_aside(probability)
    return RecoveredLineOfSight(
        probability, _past_unobserved(geographic, asked, position_m, config)
    )


def _certain(clear: Mask, where: Where) -> NDArray[np.float32]:
    """Probability (rows, cols): 1 in clear cells; the rest of a large site takes no memory."""
    probability = new_layer(clear.shape, np.float32, where)
    for part in windows(where, aside=[probability]):
        probability[part.cells][clear[part.cells]] = 1.0
    return probability


def _past_solids(
    geographic: GeographicMap, free: Mask, position_m: Floats, config: RadioConfig
) -> NDArray[np.float32]:
    """Probability of line of sight (rows, cols) past certain and uncertain solids."""
    geometry, where = geographic.geometry, geographic.where
    plans = Polygons.of_solids(geometry, geographic.solids)
    on_face = by_windows(where, 0, lambda window: free[window] & plans.any(window))
    position_m = _on_room_side(geographic, free, on_face, position_m, config.mount_radius_m)
    antenna_m = config.antenna_height_m
    solids = [solid for solid in geographic.solids if solid.height_m > 0.0]
    sure, groups = split_by_certainty(
        geographic.solids, geographic.height_groups, float(position_m[2]), antenna_m
    )
    clear = line_of_sight_past_solids(geometry, sure, position_m, antenna_m, where=where)
    for part in windows(where):
        clear[part.cells] &= free[part.cells]
    # The centre of a free cell on a wall's face may come to lie a little inside the wall.
    faces = cells_of(on_face, where)
    points_m = moved_to_faces(geometry.center_of(faces), solids)
    at_face = line_of_sight_to_points(points_m, sure, position_m, antenna_m)
    clear[faces[:, 0], faces[:, 1]] = at_face
    probability = _certain(clear, where)
    del clear
    multiply_by_group_probabilities(
        probability, geometry, groups, on_face, points_m, position_m, antenna_m, where
    )
    return probability


def unobserved_pockets(geographic: GeographicMap) -> Mask:
    """Unobserved cells (rows, cols) in pockets with an open border to free space.

    The inside of walls has the walls' height; behind an open border there may be anything. Gaps
    narrower than a robot are places where a wall was not hit, not entrances.
    """
    states, where = geographic.states, geographic.where
    least = math.ceil(round(_GAP_M / geographic.geometry.resolution_m, 9))
    wide = larger_than(_open_border(geographic), least - 1, where)
    if not len(cells_of(wide, where)):
        return wide
    unknown = by_windows(where, 0, lambda window: states[window] == CellState.UNKNOWN)
    return joined(unknown, wide, where, through=True)


def _open_border(geographic: GeographicMap) -> Mask:
    """Unknown cells (rows, cols) beside a free one and with no wall beside them."""
    states, outlined = geographic.states, _outlined(geographic.geometry, geographic.solids)

    def border(window: Window) -> Mask:
        """Border cells of a window."""
        # A wall one cell deep has holes where its face lies on centres, none without wall beside.
        wall = (states[window] == CellState.OBSTACLE) | outlined[window]
        free = is_free(states[window]).view(np.uint8)
        near_wall = cv2.dilate(wall.view(np.uint8), _AROUND).view(np.bool_)
        beside = cv2.dilate(free, _SIDES).view(np.bool_) & ~near_wall
        return np.asarray(beside & (states[window] == CellState.UNKNOWN))

    return by_windows(geographic.where, 1, border)


def _outlined(geometry: GridGeometry, solids: Sequence[Solid]) -> Mask:
    """Cells (rows, cols) that an edge of a solid passes."""
    passed = np.zeros(geometry.shape, dtype=np.bool_)
    if solids:
        edges = np.concatenate([edges_m(solid.corners_m) for solid in solids])
        origin = (geometry.origin_x_m, geometry.origin_y_m) * 2
        _, cells = cells_passed((edges - origin) / geometry.resolution_m, geometry.shape, 0.0)
        passed.flat[cells] = True
    return passed


def _past_unobserved(
    geographic: GeographicMap, asked: Mask, position_m: Floats, config: RadioConfig
) -> Mask:
    """Links (rows, cols), of those asked, through unobserved cells: line of sight unknown."""
    unseen, geometry = unobserved_pockets(geographic), geographic.geometry
    if geographic.tiles is not None:
        return _through_cells(unseen, geometry, asked, position_m, config, geographic.tiles)
    past, window = (
        np.zeros(asked.shape, dtype=np.bool_),
        _links_window(geometry, asked, position_m),
    )
    if unseen[window].any():
        cut = np.ascontiguousarray(unseen[window]), geometry.part(*window), asked[window]
        past[window] = _through_cells(*cut, position_m, config, cut[0].shape)
    return past


def _through_cells(
    unseen: Mask,
    geometry: GridGeometry,
    asked: Mask,
    position_m: Floats,
    config: RadioConfig,
    where: Where,
) -> Mask:
    """Links (rows, cols), of those asked, through any of the unseen cells."""
    clear = line_of_sight_past_cells(
        geometry,
        unseen,
        position_m,
        config.antenna_height_m,
        mount_radius_m=config.mount_radius_m,
        where=where,
    )
    return by_windows(where, 0, lambda window: asked[window] & ~clear[window])


def _links_window(geometry: GridGeometry, cells: Mask, position_m: Floats) -> Window:
    """Window of a grid that contains all links from a position to some cells."""
    here = np.maximum(geometry.cell_of(position_m[:2]), 0)
    ends = [np.flatnonzero(cells.any(axis=1 - axis)) for axis in range(2)]
    lows = [min([*at[:1], n]) for at, n in zip(ends, here.tolist(), strict=True)]
    pasts = [max([*at[-1:], n]) + 1 for at, n in zip(ends, here.tolist(), strict=True)]
    return slice(int(lows[0]), int(pasts[0])), slice(int(lows[1]), int(pasts[1]))


def _on_room_side(
    geographic: GeographicMap, free: Mask, on_face: Mask, position_m: Floats, radius_m: float
) -> Floats:
    """Move an access point inside or behind a recovered wall to the wall's face in the room.

    Walls are recovered thinner than they are and a few centimetres off, so that a point mounted on
    one may lie nearer to its back, or behind it. The nearest free cell decides the side it serves.
    """
    geometry, plan = geographic.geometry, position_m[:2]
    reach_m = radius_m + geometry.resolution_m
    low = np.maximum(geometry.cell_of(plan - reach_m), 0)
    high = np.maximum(geometry.cell_of(plan + reach_m) + 1, 0)
    near = slice(low[0], high[0]), slice(low[1], high[1])
    cells = geometry.center_of(np.argwhere(free[near] & ~on_face[near]) + low)
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
