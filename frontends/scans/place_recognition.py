# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which submaps look alike, wherever the robot is believed to be.

A submap is drawn as a picture of its walls. The size of the picture's Fourier transform does not
change when the walls are moved, and turns when they are turned; sampled on rings, and transformed
once more along each ring, it does not change with either (Casasent and Psaltis, "Position, rotation
and scale invariant optical correlation", Applied Optics 15(7), 1976, without the scale). Alike
places have alike numbers, whatever was believed of where they are.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats

_CELL_M = 0.25
"""Cell of the picture: what a drift within a submap blurs, and no more."""
_SIDE = 128
"""Cells of a side: 32 m, more than a submap shows of a building."""
_BLUR_CELLS = 1.0
"""Of the walls: half a cell of misplacement then changes little."""
_RINGS, _ANGLES, _HARMONICS = 20, 64, 10
"""Rings of the spectrum up to 1 / (6 cells), angles on each (half a turn), harmonics kept."""


def describe(points: Floats) -> Floats:
    """Return numbers (D,) of unit length that tell a place, wherever it is and however turned.

    Parameters
    ----------
    points : (K, 2) float64
        Returns of a submap in any frame [m].
    """
    middle = np.median(points, axis=0)
    cells = np.floor((points - middle) / _CELL_M).astype(np.int64) + _SIDE // 2
    cells = cells[((cells >= 0) & (cells < _SIDE)).all(axis=1)]
    picture = np.zeros((_SIDE, _SIDE), dtype=np.float32)
    picture[cells[:, 1], cells[:, 0]] = 1.0
    blurred = cv2.GaussianBlur(picture, (0, 0), _BLUR_CELLS)
    spectrum = np.fft.fftshift(np.abs(np.fft.fft2(blurred))).astype(np.float32)
    columns, rows = _rings()
    sampled = np.log1p(cv2.remap(spectrum, columns, rows, cv2.INTER_LINEAR))
    sampled -= sampled.mean(axis=1, keepdims=True)
    harmonics = np.abs(np.fft.rfft(sampled, axis=1))[:, 1 : _HARMONICS + 1].ravel()
    return np.asarray(harmonics / max(float(np.linalg.norm(harmonics)), 1e-12), dtype=np.float64)


@cache
def _rings() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where the spectrum is sampled: columns and rows (rings, angles)."""
    angles = np.pi * np.arange(_ANGLES) / _ANGLES
    radii = np.linspace(1.0, _SIDE / 6.0, _RINGS)[:, None]
    columns = _SIDE // 2 + radii * np.cos(angles)
    rows = _SIDE // 2 + radii * np.sin(angles)
    return columns.astype(np.float32), rows.astype(np.float32)
