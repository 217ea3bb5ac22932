# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Interactive figures of maps: occupancy grid, geographic map, differences of two maps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from slarm_graph.eval.page import Figure, plain, png_uri, single
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.raster.bands import bands, windows
from slarm_graph.raster.layers import set_aside
from slarm_graph.tiles import columns_of
from slarm_graph.world import Solid

_MAX_MAP_PIXELS = 1_500_000
"""Pixels of a map's picture: a page of 1000 pixels can be zoomed into, and walls of one cell
stay."""
_SHARP_PIXELS = 1_000
"""Least width or height of a picture: browsers blur what they enlarge."""
_FREE, _UNKNOWN, _OCCUPIED = 255, 226, 40
"""Shades of grey: white, a light and a dark one, far enough apart to be distinguished in print."""
_GROUND = "#e2e2e2"
_STATES: Mapping[int, tuple[str, str]] = {
    CellState.ACCESSIBLE: ("accessible", "#ffffff"),
    CellState.EXPANSION: ("too near to an obstacle", "#f2cf8f"),
    CellState.ENCLOSED: ("free, out of reach", "#9cc7ea"),
    CellState.OBSTACLE: ("obstacle", "#282828"),
    CellState.UNKNOWN: ("unknown", _GROUND),
}
_SOLID = "#b8541a"


MAP_WORDS = "White is free, black occupied, grey unknown."
HEIGHT_WORDS = "Heights that are not written show under the pointer."
_PAGE_PX, _TALL_PX = 1000.0, 760.0
"""Approximate width of a page, and the largest height of a map in the template."""
_LETTER_PX, _LINE_PX = 8.0, 18.0
"""Width of a letter and height of a line at the page's font of 13 px [px]."""
_MOST_LABELLED = 500
"""Number of largest obstacles that show name and height on hovering: more than anyone points
at, and 100 bytes of the page each."""
_LEAST_M = 1e-6
"""Keeps quotients finite where two labels coincide, or an obstacle has no width."""
_ROOM_FOR_LABEL = 1.5
"""A label is drawn where an obstacle is so many times as long, or as wide; else on hovering."""


def map_picture(grid: OccupancyGrid) -> tuple[str, GridGeometry]:
    """Return the map as an image's data URI, downsampled where it is large.

    Occupied cells stay visible at any scale.
    """
    g = grid.geometry
    step = max(1, math.ceil(math.sqrt(g.rows * g.cols / _MAX_MAP_PIXELS)))
    rows, cols = (-(-n // step) for n in g.shape)
    picture = np.full((rows, cols), _UNKNOWN, dtype=np.uint8)
    for band in bands((rows, cols * step * step)):
        fine = slice(band.start * step, min(band.stop * step, g.rows))
        for some in columns_of(grid.where, fine):
            across = slice(some.start // step, -(-some.stop // step))
            wide = slice(across.start * step, min(across.stop * step, g.cols))
            picture[band, across] = _darkest(grid.in_window((fine, wide)), step)
        set_aside(grid.probability)
    return _sharp_uri(picture), _coarser(g, step, picture.shape)


def _coarser(geometry: GridGeometry, step: int, shape: tuple[int, ...]) -> GridGeometry:
    """Return a geometry of this shape with cells `step` times as large."""
    rows, cols = shape
    return replace(geometry, resolution_m=geometry.resolution_m * step, rows=rows, cols=cols)


def _darkest(grid: OccupancyGrid, step: int) -> NDArray[np.uint8]:
    """Return the darkest shade of every block of cells; outside the grid cells are unknown."""
    rows, cols = (-(-n // step) for n in grid.geometry.shape)
    image = np.full((rows * step, cols * step), _UNKNOWN, dtype=np.uint8)
    inner = image[: grid.geometry.rows, : grid.geometry.cols]
    inner[grid.free] = _FREE
    inner[grid.occupied] = _OCCUPIED
    return np.asarray(image.reshape(rows, step, cols, step).min(axis=(1, 3)))


def _sharp_uri(cells: NDArray[np.uint8]) -> str:
    """Return cells (rows, cols, ...), the lowest row first, as an image's data URI."""
    times = math.ceil(_SHARP_PIXELS / max(cells.shape[:2]))
    large = cells[::-1].repeat(times, axis=0).repeat(times, axis=1)
    return png_uri(np.ascontiguousarray(large))


def geographic_figure(geographic: GeographicMap) -> Figure:
    """Return a figure of the geographic map: states of cells, obstacles of known height."""
    fig = go.Figure()
    picture, geometry = _class_picture(geographic.states, geographic.geometry, _STATES)
    add_background_map(fig, picture, geometry)
    found = _found(geographic)
    _add_legend(fig, (look for state, look in _STATES.items() if state in found))
    known = [solid for solid in geographic.solids if math.isfinite(solid.height_m)]
    known.sort(key=lambda solid: -float(np.ptp(solid.corners_m, axis=0).sum()))
    _add_outlines(fig, known[:_MOST_LABELLED], labelled=True)
    _add_outlines(fig, known[_MOST_LABELLED:], labelled=False)
    _add_heights(fig, known[:_MOST_LABELLED], px_per_m(geometry))
    metric_axes(fig, geometry)
    return Figure(fig, "Recovered map by the state of its cells", aspect=aspect(geometry))


def _found(geographic: GeographicMap) -> set[int]:
    """Return which states occur among the cells."""
    found = {int(CellState.UNKNOWN)} if geographic.tiles else set()
    for part in windows(geographic.where):
        here = geographic.states[part.cells]
        found.update(state for state in _STATES if state not in found and (here == state).any())
    return found


def difference_figure(
    classes: NDArray[np.uint8], geometry: GridGeometry, looks: Mapping[int, tuple[str, str]]
) -> Figure:
    """Return a figure of the differences of two maps, by the class of every cell (rows, cols)."""
    fig = go.Figure()
    picture, shown = _class_picture(classes, geometry, looks)
    add_background_map(fig, picture, shown)
    _add_legend(fig, looks.values())
    metric_axes(fig, shown)
    return Figure(fig, "Where two maps differ", aspect=aspect(shown))


def _add_legend(fig: go.Figure, looks: Iterable[tuple[str, str]]) -> None:
    """Add legend entries for the colours of an image: (label, colour)."""
    for name, color in looks:
        line = {"width": 1, "color": "#888888"}
        marker = {"symbol": "square", "size": 11, "color": color, "line": line}
        fig.add_scatter(x=[None], y=[None], mode="markers", name=plain(name), marker=marker)


def _class_picture(
    classes: NDArray[np.uint8], geometry: GridGeometry, looks: Mapping[int, tuple[str, str]]
) -> tuple[str, GridGeometry]:
    """Return classes as an image's data URI, every n-th cell where there are many."""
    step = max(1, math.ceil(math.sqrt(classes.size / _MAX_MAP_PIXELS)))
    cells = classes[::step, ::step]
    shown = _coarser(geometry, step, cells.shape)
    palette = np.zeros((256, 3), dtype=np.uint8)
    for kind, (_, color) in looks.items():
        palette[kind] = np.frombuffer(bytes.fromhex(color[1:]), dtype=np.uint8)
    return _sharp_uri(palette[cells]), shown


def _add_outlines(fig: go.Figure, solids: Sequence[Solid], *, labelled: bool) -> None:
    """Draw the outlines of obstacles as one trace, in a thousandth of the time of one for each.

    With `labelled`, their corners and centres show name and height on hovering.
    """
    if not solids:
        return
    gap = np.full((1, 2), np.nan)
    rings = [
        np.vstack([s.corners_m, s.corners_m[:1], gap, s.corners_m.mean(axis=0)[None], gap])
        for s in solids
    ]
    line = single(np.concatenate(rings))
    words = [plain(f"{s.name} {_height(s)}") for s in solids] if labelled else []
    fig.add_scatter(
        x=line[:, 0],
        y=line[:, 1],
        mode="lines",
        line={"color": _SOLID, "width": 2 if labelled else 1},
        hoverinfo="text" if labelled else "skip",
        text=[word for word, ring in zip(words, rings, strict=False) for _ in ring] or None,
        showlegend=False,
    )


def _add_heights(fig: go.Figure, solids: Sequence[Solid], scale_px_m: float) -> None:
    """Label obstacles with their heights where there is room, the first solids first.

    An annotation's name is the least scale [px/m] at which the template shows it: its obstacle is
    large enough, and no label before it is in the way.
    """
    written: list[tuple[float, float, float]] = []
    labels: list[dict[str, object]] = []
    for solid in solids:
        label = _height(solid)
        x, y = solid.corners_m.mean(axis=0)
        wide_px = _LETTER_PX * len(label)
        room = np.array([wide_px, _LINE_PX]) * _ROOM_FOR_LABEL
        size_m = np.ptp(solid.corners_m, axis=0) + _LEAST_M
        least = float((room / size_m).min())
        for other_x, other_y, other_px in written:
            beside = 0.5 * (wide_px + other_px) / (abs(x - other_x) + _LEAST_M)
            least = max(least, min(beside, _LINE_PX / (abs(y - other_y) + _LEAST_M)))
        if least <= scale_px_m:
            written.append((x, y, wide_px))
            labels.append(
                {
                    "x": x,
                    "y": y,
                    "text": f"<b>{label}</b>",
                    "showarrow": False,
                    "font": {"color": _SOLID},
                    "bgcolor": "#ffffff",
                    "name": f"{least:.4g}",
                }
            )
    fig.layout.annotations += tuple(labels)


def _height(solid: Solid) -> str:
    return f"{solid.height_m:.3g} m"


def add_background_map(fig: go.Figure, picture: str, geometry: GridGeometry) -> None:
    """Add an image of a map as the background, over the cells it shows."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    fig.add_layout_image(
        source=picture,
        xref="x",
        yref="y",
        x=x_min,
        y=y_max,
        sizex=x_max - x_min,
        sizey=y_max - y_min,
        sizing="stretch",
        layer="below",
    )


def aspect(geometry: GridGeometry) -> float:
    """Return the height of a map over its width."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    return (y_max - y_min) / (x_max - x_min)


def px_per_m(geometry: GridGeometry) -> float:
    """Return the approximate scale of a map on the page [px/m]."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    tall_px = min(_PAGE_PX * aspect(geometry), _TALL_PX)
    return min(_PAGE_PX / (x_max - x_min), tall_px / (y_max - y_min))


def metric_axes(fig: go.Figure, geometry: GridGeometry) -> None:
    """Set the axes to the extent of a grid, with equal scales."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    looks = {"showgrid": False, "zeroline": False, "constrain": "domain"}
    fig.update_xaxes(title="x [m]", range=[x_min, x_max], **looks)
    fig.update_yaxes(title="y [m]", range=[y_min, y_max], scaleanchor="x", **looks)
    fig.update_layout(
        plot_bgcolor=_GROUND, meta={"ground": True, "width_m": x_max - x_min}, dragmode="pan"
    )
