# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy maps as files: map_server's image and YAML, by nav2's rules."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid

Mode = Literal["trinary", "scale", "raw"]

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196
_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


def trinary_image(occupied: Mask, free: Mask) -> NDArray[np.uint8]:
    """Return the image (rows, cols) of a map, its first row the largest y.

    Parameters
    ----------
    occupied, free : (rows, cols) bool
        Row 0 lowest; cells in neither are unknown.
    """
    image = np.full(occupied.shape, UNKNOWN, dtype=np.uint8)
    image[free] = FREE
    image[occupied] = OCCUPIED
    return np.ascontiguousarray(image[::-1])


def pgm_bytes(image: NDArray[np.uint8]) -> bytes:
    """Encode an image as binary PGM (P5)."""
    done, data = cv2.imencode(".pgm", image)
    if not done:
        raise RuntimeError("OpenCV could not encode a PGM image")
    return data.tobytes()


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


@dataclass(frozen=True, slots=True)
class _Description:
    """What a map's YAML says."""

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
    description = _described(path, _yaml_mapping(path))
    pixels, opaque = _pixels(description.image)
    pixels, opaque = pixels[::-1], opaque[::-1]
    probability = np.where(opaque, _probability(pixels, description), np.nan)
    x, y, resolution = description.geometry_from
    geometry = GridGeometry(x, y, resolution, *pixels.shape)
    return OccupancyGrid(
        geometry,
        probability.astype(np.float32),
        occupied_at=description.occupied_thresh,
        free_at=description.free_thresh,
    )


def _yaml_mapping(path: Path) -> Mapping[str, object]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"{path}: cannot be read as a map's YAML ({reason})") from None
    if not isinstance(content, dict):
        raise BadInput(f"{path}: not a map's YAML; expected keys {', '.join(_REQUIRED)}")
    return content


def _described(path: Path, content: Mapping[str, object]) -> _Description:
    missing = [key for key in _REQUIRED if key not in content]
    if missing:
        raise BadInput(f"{path}: missing key '{missing[0]}'")
    origin = content["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise BadInput(f"{path}: 'origin' should have 3 elements [x, y, yaw], not {origin!r}")
    mode = content.get("mode", "trinary")
    if mode not in ("trinary", "scale", "raw"):
        raise BadInput(f"{path}: mode '{mode}' is none of trinary, scale, raw")
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    if yaw != 0.0:
        raise BadInput(f"{path}: the map is turned by {yaw} rad; only yaw 0 is supported")
    occupied, free = (_number(path, k, content[k]) for k in ("occupied_thresh", "free_thresh"))
    if not 0.0 <= free < occupied <= 1.0:
        raise BadInput(f"{path}: needs 0 <= free_thresh < occupied_thresh <= 1")
    resolution = _number(path, "resolution", content["resolution"])
    if resolution <= 0.0:
        raise BadInput(f"{path}: resolution must be positive, not {resolution}")
    return _Description(
        path.parent / str(content["image"]),
        (x, y, resolution),
        bool(content["negate"]),
        occupied,
        free,
        mode,
    )


def _number(path: Path, key: str, value: object) -> float:
    try:
        number = float(cast(str, value))
    except (TypeError, ValueError):
        raise BadInput(f"{path}: '{key}' is not a number: {value!r}") from None
    if not math.isfinite(number):
        raise BadInput(f"{path}: '{key}' is not finite: {value!r}")
    return number


def _pixels(path: Path) -> tuple[Floats, Mask]:
    """Return shades (rows, cols), 0 to 255 from the top of the image, and which are opaque."""
    if not path.is_file():
        raise BadInput(f"no such file: {path} (the map's image)")
    data = np.fromfile(path, dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if image is None:
        raise BadInput(f"{path}: not an image that can be read")
    full = 65535.0 if image.dtype == np.uint16 else 255.0
    shades = image.astype(np.float64) * (255.0 / full)
    if shades.ndim == 2:
        return shades, np.ones(shades.shape, dtype=np.bool_)
    has_alpha = shades.shape[2] in (2, 4)
    colours = shades[..., :-1] if has_alpha else shades
    opaque = shades[..., -1] >= 255.0 if has_alpha else np.ones(shades.shape[:2], dtype=np.bool_)
    return colours.mean(axis=2), opaque


def _probability(shades: Floats, description: _Description) -> Floats:
    if description.mode == "raw":
        return np.where(shades > 100.0, np.nan, shades / 100.0)
    p = shades / 255.0 if description.negate else (255.0 - shades) / 255.0
    occupied, free = p >= description.occupied_thresh, p <= description.free_thresh
    between = np.full(p.shape, np.nan)
    if description.mode == "scale":
        share = (p - description.free_thresh) / (
            description.occupied_thresh - description.free_thresh
        )
        between = np.round(share, 2)
    return np.where(occupied, 1.0, np.where(free, 0.0, between))
