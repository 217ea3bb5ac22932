# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Point-to-line scan likelihood in a particle's map: associations, log likelihood, curvature."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.backends.particle_maps import (
    NO_TILE,
    TILE_BITS,
    Indices,
    Tables,
    Tiles,
    within_tile,
)
from slarm_graph.frontends.scans.small_matrix import add_square3, mirror3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with

_MIN_COSINE = 0.5
"""Least cosine between the normals of a point and of a cell it is associated with; and least length
of the mean of a cell's normals, by which it has one."""
_FLATNESS = 0.1
"""Variance across over along up to which neighbouring points lie on a line and have a normal: a
spread of 0.02 m over 0.06 m. Half makes a ward 0.057 m in place of 0.039 and an office 0.044 in
place of 0.039, mit-csail stays."""
_BLOCK = 32
"""Likelihood ratios multiplied before a logarithm is taken: no product of so many overflows."""
_FUSED = frozenset({"reassoc", "contract"})
"""Permitted floating-point rewrites. A callee inlined into its first caller inherits them, so both
are declared: bytes must not depend on which was compiled first."""


@kernel
def point_normals(points: Floats, origin: Floats) -> Floats:
    """Return points (K, 2) in beam order with unit normals towards the laser, (K, 4).

    The normal is that of the line through the neighbours; (0, 0) where they lie on no line.
    """
    window, gap_m = 3, 0.5
    out = np.zeros((len(points), 4))
    for i in range(len(points)):
        n, sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        x0, y0 = points[i, 0], points[i, 1]
        for j in range(max(0, i - window), min(len(points), i + window + 1)):
            dx, dy = points[j, 0] - x0, points[j, 1] - y0
            if dx * dx + dy * dy > gap_m * gap_m:
                continue
            n += 1.0
            sx += dx
            sy += dy
            sxx += dx * dx
            sxy += dx * dy
            syy += dy * dy
        out[i, 0], out[i, 1] = x0, y0
        if n < 3.0:
            continue
        cxx, cxy, cyy = (
            sxx / n - sx * sx / n / n,
            sxy / n - sx * sy / n / n,
            syy / n - sy * sy / n / n,
        )
        mean, half = 0.5 * (cxx + cyy), math.hypot(0.5 * (cxx - cyy), cxy)
        if mean - half > _FLATNESS * (mean + half) or mean + half < 1e-6:
            continue
        along = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
        nx, ny = -math.sin(along), math.cos(along)
        sign = 1.0 if nx * (origin[0] - x0) + ny * (origin[1] - y0) > 0.0 else -1.0
        out[i, 2], out[i, 3] = sign * nx, sign * ny
    return out


@kernel
def associate(
    tiles: Tiles, particle: int, kernel: int, points: Floats, pose: Floats, lines: Floats
) -> int:
    """Associate every point at a pose with the nearest mean end point of similar normal.

    Fills `lines` (K, 5) with mean end point x, y [m], normal x, y (0, 0 where it has none) and 1
    where there is one; returns the number of associations.
    """
    tables, corner, cells, resolution = tiles
    table = tables[particle]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    associated = 0
    for k in range(len(points)):
        x = (pose[0] + c * points[k, 0] - s * points[k, 1]) / resolution
        y = (pose[1] + s * points[k, 0] + c * points[k, 1]) / resolution
        nx = c * points[k, 2] - s * points[k, 3]
        ny = s * points[k, 2] + c * points[k, 3]
        directed = nx != 0.0 or ny != 0.0
        col0, row0 = math.floor(x), math.floor(y)
        best = (kernel + 0.5) ** 2
        lines[k, 4] = 0.0
        for row in range(row0 - kernel, row0 + kernel + 1):
            for col in range(col0 - kernel, col0 + kernel + 1):
                tile = _tile_at(table, corner, row, col)
                if tile < 0:
                    continue
                at = within_tile(row, col)
                n = cells[tile, at, 0]
                if n == 0.0:
                    continue
                mx, my = col + 0.5 + cells[tile, at, 1] / n, row + 0.5 + cells[tile, at, 2] / n
                distance = (x - mx) ** 2 + (y - my) ** 2
                if distance >= best:
                    continue
                cx, cy = cells[tile, at, 3], cells[tile, at, 4]
                size = math.sqrt(cx * cx + cy * cy)
                smooth = size > _MIN_COSINE * n
                if directed and smooth and nx * cx + ny * cy < _MIN_COSINE * size:
                    continue
                best = distance
                lines[k, 0], lines[k, 1] = mx * resolution, my * resolution
                if smooth:
                    lines[k, 2], lines[k, 3] = cx / size, cy / size
                else:
                    lines[k, 2], lines[k, 3] = 0.0, 0.0
                lines[k, 4] = 1.0
        if lines[k, 4] > 0.0:
            associated += 1
    return associated


@kernel_with(inline=True)
def _tile_at(table: Tables, corner: Indices, row: int, col: int) -> int:
    """Number of the tile that a cell of the plane lies in, or `NO_TILE`."""
    tile_row, tile_col = (row >> TILE_BITS) - corner[0], (col >> TILE_BITS) - corner[1]
    if tile_row < 0 or tile_col < 0 or tile_row >= table.shape[0] or tile_col >= table.shape[1]:
        return NO_TILE
    return int(table[tile_row, tile_col])


@kernel
def log_no_match(kernel: int, resolution: float, sigma: float) -> float:
    """Log likelihood of a point without association: that at the search radius."""
    reach = (kernel + 0.5) * resolution
    return -math.log(1.0 + (reach / sigma) ** 2)


@kernel_with(fastmath=_FUSED)
def log_likelihood(points: Floats, lines: Floats, pose: Floats, sigma: float, miss: float) -> float:
    """Return log p(o | m, x) up to a constant: Cauchy tails, `miss` for points without a line."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, product = 0.0, 1.0
    for k in range(len(points)):
        if lines[k, 4] == 0.0:
            total += miss
            continue
        dx = pose[0] + c * points[k, 0] - s * points[k, 1] - lines[k, 0]
        dy = pose[1] + s * points[k, 0] + c * points[k, 1] - lines[k, 1]
        if lines[k, 2] != 0.0 or lines[k, 3] != 0.0:
            r = dx * lines[k, 2] + dy * lines[k, 3]
            square = r * r
        else:
            square = dx * dx + dy * dy
        product *= 1.0 + square / (sigma * sigma)
        if product > 1e200:
            total -= math.log(product)
            product = 1.0
    return total - math.log(product)


@kernel_with(fastmath=_FUSED)
def log_likelihoods(
    points: Floats, lines: Floats, poses: Floats, sigma: float, miss: float, out: Floats
) -> None:
    """Fill `out` (Z,) with `log_likelihood` at poses (Z, 3), for many poses and one association.

    With normal n and mean end point l of a line, the distance of point p to it is linear in
    position, cosine and sine: r = n.t + cos n.p + sin n x p - n.l.
    """
    # Blocks of fixed size are worked off several at a time; the rest of the last one adds nothing.
    forms = np.zeros((len(points) // _BLOCK + 1, 5, _BLOCK))
    undirected, count, missed = np.zeros(len(points), dtype=np.bool_), 0, 0
    for k in range(len(points)):
        nx, ny = lines[k, 2] / sigma, lines[k, 3] / sigma
        if lines[k, 4] == 0.0:
            missed += 1
        elif nx == 0.0 and ny == 0.0:
            undirected[k] = True
        else:
            form, at = forms[count // _BLOCK], count % _BLOCK
            form[0, at], form[1, at] = nx, ny
            form[2, at] = points[k, 0] * nx + points[k, 1] * ny
            form[3, at] = points[k, 0] * ny - points[k, 1] * nx
            form[4, at] = lines[k, 0] * nx + lines[k, 1] * ny
            count += 1
    others, other_lines = points[undirected], lines[undirected]
    for z in range(len(poses)):
        x, y = poses[z, 0], poses[z, 1]
        c, s = math.cos(poses[z, 2]), math.sin(poses[z, 2])
        out[z] = missed * miss + log_likelihood(others, other_lines, poses[z], sigma, miss)
        for block in range(len(forms)):
            form, product = forms[block], 1.0
            for k in range(_BLOCK):
                r = x * form[0, k] + y * form[1, k] + c * form[2, k] + s * form[3, k] - form[4, k]
                product *= 1.0 + r * r
            out[z] -= math.log(product)


@kernel
def curvature(
    points: Floats,
    lines: Floats,
    pose: Floats,
    sigma: float,
    gain: float,
    hessian: Floats,
    gradient: Floats,
) -> None:
    """Add Gauss-Newton terms of -gain * log_likelihood to `hessian` (3, 3), `gradient` (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(points)):
        if lines[k, 4] == 0.0:
            continue
        ax, ay = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        dx, dy = pose[0] + ax - lines[k, 0], pose[1] + ay - lines[k, 1]
        nx, ny = lines[k, 2], lines[k, 3]
        if nx != 0.0 or ny != 0.0:
            r = dx * nx + dy * ny
            w = 2.0 * gain / (sigma * sigma + r * r)
            jt = ax * ny - ay * nx
            add_square3(hessian, nx, ny, jt, w)
            gradient[0] += w * r * nx
            gradient[1] += w * r * ny
            gradient[2] += w * r * jt
        else:
            w = 2.0 * gain / (sigma * sigma + dx * dx + dy * dy)
            hessian[0, 0] += w
            hessian[1, 1] += w
            hessian[0, 2] -= w * ay
            hessian[1, 2] += w * ax
            hessian[2, 2] += w * (ax * ax + ay * ay)
            gradient[0] += w * dx
            gradient[1] += w * dy
            gradient[2] += w * (dy * ax - dx * ay)
    mirror3(hessian)


@kernel
def scale_square(points: Floats, lines: Floats, pose: Floats, sigma: float) -> float:
    """One step of expectation maximisation of the scale of the residuals of a scan [m^2].

    A Cauchy distance of scale s is normal with a variance of its own for every point, of which the
    residual r leaves an expected weight of 2 / (1 + r^2 / s^2): the mean of the weighted squares is
    the next s^2 (Dempster, Laird and Rubin, "Iteratively Reweighted Least Squares for Linear
    Regression When Errors are Normal/Independent Distributed", 1980). NaN where nothing matched.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, count = 0.0, 0
    for k in range(len(points)):
        nx, ny = lines[k, 2], lines[k, 3]
        if lines[k, 4] == 0.0 or (nx == 0.0 and ny == 0.0):
            continue
        r = (pose[0] + c * points[k, 0] - s * points[k, 1] - lines[k, 0]) * nx + (
            pose[1] + s * points[k, 0] + c * points[k, 1] - lines[k, 1]
        ) * ny
        total += 2.0 * r * r / (1.0 + r * r / (sigma * sigma))
        count += 1
    return total / count if count else math.nan
