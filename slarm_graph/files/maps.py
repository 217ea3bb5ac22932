# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy maps as files: map_server's image and YAML, by nav2's rules."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput, brief
from slarm_graph.files.images import Image, read_image
from slarm_graph.files.yaml_text import number, read_yaml
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import bands
from slarm_graph.raster.layers import set_aside
from slarm_graph.tiles import Where, Window, columns_of, shape_of

_log = logging.getLogger(__name__)

Masks = Callable[[Window], tuple[Mask, Mask]]
"""Returns the occupied and the free cells of a window of a map."""
Mode = Literal["trinary", "scale", "raw"]

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Shades that map_server's map_saver writes."""
_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196
"""Thresholds that map_saver writes; the shade of unknown, (255 - 205) / 255 = 0.196, is no longer
free by the second."""
MAX_RESOLUTION_M = 100.0
"""Largest plausible cell size; beyond it a unit was mistaken."""
MAX_ORIGIN_M = 1e8
"""Largest coordinate of the origin: farther off, float64 no longer tells millimetres apart
when cells are counted; UTM coordinates, the largest that are used for maps, stay below 10^7 m."""
_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


def trinary_image(occupied: Mask, free: Mask) -> NDArray[np.uint8]:
    """Return the image (rows, cols) of a map, its first row the largest y.

    Parameters
    ----------
    occupied, free : (rows, cols) bool
        Row 0 lowest; cells in neither are unknown.
    """
    free_or_not = np.where(free[::-1], np.uint8(FREE), np.uint8(UNKNOWN))
    return np.where(occupied[::-1], np.uint8(OCCUPIED), free_or_not)


def write_trinary(path: Path, where: Where, masks: Masks) -> None:
    """Write a map as binary PGM (P5), in bands of rows to save memory.

    Parameters
    ----------
    path : Path
    where : (rows, cols) or KnownTiles
        Outside of known tiles cells are unknown.
    masks : function of a window
    """
    rows, cols = shape_of(where)
    with path.open("wb") as file:
        file.write(b"P5\n%d %d\n255\n" % (cols, rows))
        for band in reversed(list(bands((rows, cols)))):
            image = np.full((band.stop - band.start, cols), UNKNOWN, dtype=np.uint8)
            for some in columns_of(where, band):
                image[:, some] = trinary_image(*masks((band, some)))
            file.write(image.tobytes())


def png_bytes(image: NDArray[np.uint8]) -> bytes:
    """Encode an image (rows, cols) or (rows, cols, 3) RGB, top row first, as PNG."""
    done, data = cv2.imencode(".png", image[..., ::-1] if image.ndim > 2 else image)
    if not done:
        raise RuntimeError("OpenCV could not encode a PNG image")
    return data.tobytes()


def map_yaml(image_name: str, geometry: GridGeometry) -> str:
    """Return the YAML beside a trinary image, numbers with full precision."""
    x, y, resolution = (
        np.format_float_positional(value, trim="0")
        for value in (geometry.origin_x_m, geometry.origin_y_m, geometry.resolution_m)
    )
    return (
        f"image: {image_name}\nmode: trinary\nresolution: {resolution}\n"
        f"origin: [{x}, {y}, 0.0]\nnegate: 0\n"
        f"occupied_thresh: {_OCCUPIED_THRESH}\nfree_thresh: {_FREE_THRESH}\n"
    )


def masks_of(grid: OccupancyGrid) -> Masks:
    """Return the function that gives the masks of a window and then frees the window's memory."""

    def masks(window: Window) -> tuple[Mask, Mask]:
        """Return the masks of a window."""
        part = grid.in_window(window)
        found = part.occupied, part.free
        set_aside(grid.probability)
        return found

    return masks


def write_map(path: Path, grid: OccupancyGrid) -> None:
    """Write `<name>.yaml` and beside it `<name>.pgm`, map_server's trinary form.

    Parameters
    ----------
    path : Path
        Of the YAML.
    grid : OccupancyGrid
    """
    image = path.with_suffix(".pgm")
    write_trinary(image, grid.where, masks_of(grid))
    path.write_text(map_yaml(image.name, grid.geometry), encoding="utf-8")


@dataclass(frozen=True, slots=True)
class _Description:
    """The content of a map's YAML."""

    image: Path
    geometry_from: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: Mode


def read_map(path: Path) -> OccupancyGrid:
    """Read a map_server map: trinary, scale or raw.

    Parameters
    ----------
    path : Path
        The YAML file; its image is looked up beside it.

    Returns
    -------
    OccupancyGrid
        The probability is nav2's cell value over 100: 0, 1 and nan in trinary maps, steps of a
        hundredth between the thresholds in scale maps.

    Raises
    ------
    BadInput
        When a file or a key is missing or wrong.
    """
    description = _described(path)
    probability = _probability(read_image(description.image), description)[::-1]
    x, y, resolution = description.geometry_from
    geometry = GridGeometry(x, y, resolution, *probability.shape)
    return OccupancyGrid(
        geometry,
        np.ascontiguousarray(probability),
        occupied_at=description.occupied_thresh,
        free_at=description.free_thresh,
    )


def _described(path: Path) -> _Description:
    content = read_yaml(path).content
    if not isinstance(content, dict):
        raise BadInput(f"{path}: not a map's YAML; expected keys {', '.join(_REQUIRED)}")
    missing = [key for key in _REQUIRED if key not in content]
    if missing:
        raise BadInput(f"{path}: missing key '{missing[0]}'")
    mode = content.get("mode", "trinary")
    if mode not in ("trinary", "scale", "raw"):
        raise BadInput(f"{path}: mode '{brief(mode)}' is none of trinary, scale, raw")
    occupied, free = (_number(path, k, content[k]) for k in ("occupied_thresh", "free_thresh"))
    if not 0.0 <= free < occupied <= 1.0:
        raise BadInput(f"{path}: needs 0 <= free_thresh < occupied_thresh <= 1")
    resolution = _number(path, "resolution", content["resolution"])
    if not 0.0 < resolution <= MAX_RESOLUTION_M:
        raise BadInput(
            f"{path}: resolution must be positive and at most {MAX_RESOLUTION_M:g} m,"
            f" not {resolution:g}"
        )
    return _Description(
        _image_file(path, content["image"]),
        (*_origin(path, content["origin"]), resolution),
        _number(path, "negate", content["negate"]) != 0.0,
        occupied,
        free,
        mode,
    )


def _origin(path: Path, origin: object) -> tuple[float, float]:
    """Read `[x, y, yaw]`; a yaw that is no number, as some map savers write it, counts as 0."""
    if not isinstance(origin, list) or len(origin) != 3:
        raise BadInput(f"{path}: 'origin' should have 3 elements [x, y, yaw], not {brief(origin)}")
    x, y = (_number(path, "origin", value) for value in origin[:2])
    if max(abs(x), abs(y)) > MAX_ORIGIN_M:
        raise BadInput(f"{path}: 'origin' lies {max(abs(x), abs(y)):g} m off")
    if isinstance(origin[2], (str, float)) and _is_nan(origin[2]):
        _log.warning("%s: the yaw in 'origin' is nan; taken as 0", path)
        return x, y
    yaw = _number(path, "origin", origin[2])
    if yaw != 0.0:
        raise BadInput(f"{path}: the map is turned by {yaw:g} rad; only yaw 0 is supported")
    return x, y


def _is_nan(value: str | float) -> bool:
    try:
        return math.isnan(float(value))
    except ValueError:
        return False


def _number(path: Path, key: str, value: object) -> float:
    """Read a finite number; true and false, and numbers in quotes, count as what they say."""
    if isinstance(value, bool):
        return float(value)
    try:
        return number(value)
    except ValueError:
        problem = "not finite" if isinstance(value, float) else "not a number"
    except OverflowError:
        problem = "too large"
    raise BadInput(f"{path}: '{key}' is {problem}: {brief(value)}")


def _image_file(path: Path, name: object) -> Path:
    """Return the path of a map's image: as in the YAML, else of that name beside the YAML.

    Map savers write whole paths, which are wrong once the map has moved.
    """
    if not isinstance(name, str) or not name or "\0" in name:
        raise BadInput(f"{path}: 'image' is not the name of a file: {brief(name)}")
    stated, beside = path.parent / name, path.parent / Path(name).name
    return stated if stated.is_file() or not beside.is_file() else beside


def _probability(image: Image, description: _Description) -> NDArray[np.float32]:
    """Return the probabilities (rows, cols), the first row of the image first."""
    if image.shades.dtype.kind == "f":
        found = _by_rule(np.asarray(image.shades, np.float64) / image.full, description)
    else:  # one rule per shade, not per pixel
        table = _by_rule(np.arange(image.full + 1) / image.full, description)
        found = table[image.shades]
    if image.opaque is not None:
        found[~image.opaque] = np.nan
    return found


def _by_rule(shade: Floats, description: _Description) -> NDArray[np.float32]:
    """Apply nav2's rule for shades from 0 (black) to 1 (white)."""
    if description.mode == "raw":
        value = shade * 255.0
        return np.where(value > 100.0, np.nan, value / 100.0).astype(np.float32)
    p = shade if description.negate else 1.0 - shade
    occupied, free = p >= description.occupied_thresh, p <= description.free_thresh
    between = np.full(p.shape, np.nan)
    if description.mode == "scale":
        share = (p - description.free_thresh) / (
            description.occupied_thresh - description.free_thresh
        )
        between = np.round(share, 2)
    return np.where(occupied, 1.0, np.where(free, 0.0, between)).astype(np.float32)
