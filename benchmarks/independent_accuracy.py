# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of an explored world once more, from the files of the run, by code of its own.

    python benchmarks/independent_accuracy.py RUN_FOLDER WORLD.yaml

Reads `coverage.npz`, `radio_map.npz`, `metrics.json` and the world, and shares nothing with the
package: the world is rasterised in whole tenths of a micrometre (crossing number, so that a centre
on a left or lower face is inside and one on a right or upper face is not), rays are clipped at
every convex solid one by one, 3GPP TR 38.901 InF-SH is typed in again. Worlds of boxes, convex
polygons and walls around a rectangle, without a sight-line through the boundary.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[Any]
Solid = tuple[Array, float]
"""Convex plan (K, 2) in tenths of a micrometre, counter-clockwise, and height [m]."""


def solids_of(world: dict[str, Any]) -> list[Solid]:
    """Convex pieces of all boxes and walls."""
    found = [(_rectangle(b, b["size_m"]), b["height_m"]) for b in world.get("boxes", ())]
    for polygon in world.get("polygons", ()):
        plan = np.round(np.array(polygon["corners_m"]) * 1e7).astype(np.int64)
        x, y = plan.T.astype(float)
        area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        found.append((plan if area > 0 else plan[::-1], polygon["height_m"]))
    for wall in world.get("walls", ()):
        (length, width), thick = wall["size_m"], wall["thickness_m"]
        for x, y, size in (
            (0.0, 0.5 * (width - thick), (length, thick)),
            (0.0, -0.5 * (width - thick), (length, thick)),
            (0.5 * (length - thick), 0.0, (thick, width)),
            (-0.5 * (length - thick), 0.0, (thick, width)),
        ):
            found.append((_rectangle(wall, size, (x, y)), wall["height_m"]))
    return found


def _rectangle(of: dict[str, Any], size: Any, off: tuple[float, float] = (0.0, 0.0)) -> Array:
    turn = math.radians(of.get("heading_deg", 0.0))
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    local = signs * np.asarray(size) / 2.0 + off
    c, s = math.cos(turn), math.sin(turn)
    corners = local @ np.array([[c, s], [-s, c]]) + of["center_m"]
    return np.asarray(np.round(corners * 1e7).astype(np.int64))


def inside(plan: Array, x: Array, y: Array) -> Array:
    """Crossing number of points (rows, cols) in a polygon, in twentieths of a micrometre."""
    odd = np.zeros(np.broadcast_shapes(x.shape, y.shape), dtype=bool)
    for (x0, y0), (x1, y1) in zip(2 * plan, 2 * np.roll(plan, -1, axis=0), strict=True):
        across = (y0 > y) != (y1 > y)
        left = (x - x0) * (y1 - y0) - (x1 - x0) * (y - y0)
        odd ^= across & (left < 0 if y1 > y0 else left > 0)
    return odd


def reference(world: dict[str, Any], delta_m: float) -> tuple[Array, Array, Array]:
    """Reachable cells (rows, cols), and x (cols,), y (rows,) of the centres in 1/20 um."""
    boundary = np.round(np.array(world["boundary_m"]) * 1e7).astype(np.int64)
    thin_m = min((w["thickness_m"] for w in world.get("walls", ())), default=1.0)
    parts = 1
    while delta_m / parts > min(thin_m, 0.05) + 1e-9:
        parts += 2
    low, high = boundary.min(axis=0), boundary.max(axis=0)
    step = round(delta_m * 2e7) / parts
    count = [
        math.ceil((h - w) / (delta_m * 1e7) - 1e-6) * parts for w, h in zip(low, high, strict=True)
    ]
    x, y = (np.round(2 * w + (np.arange(n) + 0.5) * step) for w, n in zip(low, count, strict=True))
    x, y = x.astype(np.int64), y.astype(np.int64)
    free = inside(boundary, x[None], y[:, None])
    for plan, _ in solids_of(world):
        free &= ~inside(plan, x[None], y[:, None])
    labels, _ = ndimage.label(free)
    start = world["start"]
    col = int((start["x_m"] * 2e7 - 2 * low[0]) // step)
    row = int((start["y_m"] * 2e7 - 2 * low[1]) // step)
    middle = slice(parts // 2, None, parts)
    reached = labels == labels[row, col]
    return reached[middle, middle], x[middle], y[middle]


def gain_db(world: dict[str, Any], ap: dict[str, Any], x_m: Array, y_m: Array, h: float) -> Array:
    """Expected gain (rows, cols) in InF-SH at 3.5 GHz."""
    blocked = np.zeros(np.broadcast_shapes(x_m.shape, y_m.shape), dtype=bool)
    for plan, height in solids_of(world):
        blocked |= _hides(plan / 1e7, height, (ap["x_m"], ap["y_m"], ap["z_m"]), x_m, y_m, h)
    away = np.sqrt((x_m - ap["x_m"]) ** 2 + (y_m - ap["y_m"]) ** 2 + (h - ap["z_m"]) ** 2)
    clear_db = 31.84 + 21.5 * np.log10(away) + 19.0 * math.log10(3.5)
    hidden_db = np.maximum(clear_db, 32.4 + 23.0 * np.log10(away) + 20.0 * math.log10(3.5))
    return -np.where(blocked, hidden_db, clear_db)


def _hides(plan: Array, top: float, ap: Any, x: Array, y: Array, h: float) -> Array:
    """Whether a prism lies in the way from an access point above it down to antennas."""
    first, last = np.zeros_like(x + y), np.ones_like(x + y)
    for (ax, ay), (bx, by) in zip(plan, np.roll(plan, -1, axis=0), strict=True):
        begin = (bx - ax) * (ap[1] - ay) - (by - ay) * (ap[0] - ax)
        end = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = begin / (begin - end)
        first = np.where((begin <= 0) & (end > 0), np.maximum(first, at), first)
        last = np.where((begin > 0) & (end <= 0), np.minimum(last, at), last)
        last = np.where((begin <= 0) & (end <= 0), -1.0, last)
    lowest = ap[2] + last * (h - ap[2])
    return np.asarray((last - first > 1e-9) & (lowest < top - 1e-9))


def accuracies(folder: Path, world: dict[str, Any]) -> list[float]:
    """Accuracy of every access point of a run, within 1 dB."""
    with np.load(folder / "coverage.npz") as file:
        accessible, delta_m = file["states"] == 1, float(file["resolution_m"])
        origin = file["origin_m"]
    with np.load(folder / "radio_map.npz") as file:
        found_db, h = file["channel_power_gain_db"], float(file["antenna_height_m"])
    reached, x, y = reference(world, delta_m)
    assert accessible.shape == reached.shape, "map and world are not on one lattice"
    assert np.allclose(origin, np.min(world["boundary_m"], axis=0))
    high = np.max(world["boundary_m"], axis=0)
    step = delta_m * 2e7
    share_x = np.clip((high[0] * 2e7 - (x - 0.5 * step)) / step, 0.0, 1.0)
    share_y = np.clip((high[1] * 2e7 - (y - 0.5 * step)) / step, 0.0, 1.0)
    weight = share_y[:, None] * share_x[None]
    x_m, y_m = x[None] / 2e7, y[:, None] / 2e7
    right = [
        accessible & (np.abs(gain_db(world, ap, x_m, y_m, h) - found) <= 1.0)
        for ap, found in zip(world["access_points"], found_db, strict=True)
    ]
    return [float(weight[hit & reached].sum() / weight[reached].sum()) for hit in right]


def main() -> int:
    """Print both figures; 1 when they differ by more than a millionth."""
    folder, world = Path(sys.argv[1]), yaml.safe_load(Path(sys.argv[2]).read_text("utf-8"))
    mine = float(np.mean(accuracies(folder, world)))
    metrics = json.loads((folder / "metrics.json").read_text("utf-8"))
    theirs = metrics["accuracy"]["value"]
    print(f"accuracy {theirs:.9f} in metrics.json, {mine:.9f} here")
    return int(abs(mine - theirs) > 1e-6)


if __name__ == "__main__":
    sys.exit(main())
