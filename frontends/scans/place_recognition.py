# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Place recognition by appearance: similar places and their relative poses, without a prior pose.

A place is rasterised to an image of its walls. The magnitude of the image's Fourier transform is
invariant to a shift of the walls and turns with them: correlated on rings it gives the rotation
between two places. The shift follows from correlating the images themselves
(Fourier-Mellin registration, Reddy and Chatterji, "An FFT-Based Technique for Translation, Rotation
and Scale-Invariant Image Registration", IEEE TIP 5(8), 1996, without the scale).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2

from slarm_graph.geometry import Floats, compose, one_per_cell, wrap_angles
from slarm_graph.kernels import kernel

_REACH_M = 20.0
"""Radius of the walls in an image: what a lidar of 30 m shows of most buildings. With 14 m
a third fewer of the revisits in opposite direction are among the ten most similar."""
_RING_CELL_M, _RING_SIDE = 0.25, 192
"""Cell of the image for rotations, and cells of a side: drift within a submap blurs as much."""
_SHIFT_CELL_M, _SHIFT_SIDE = 0.5, 96
"""Cell of the image for shifts, and cells of a side. The rotation is known to 1 degree, which at
20 m is 0.35 m; half the cell takes four times as long and finds no more."""
_BLUR_CELLS = 1.0
"""Gaussian blur of the walls: a shift of half a cell then changes little."""
_RINGS, _ANGLES = 30, 96
"""Rings of the spectrum up to 1 / (6 cells), and angles on each over half a turn."""
_HALF_TURNS = (0.0, math.pi)
"""A magnitude spectrum is point-symmetric, so that the rotation has two solutions."""

Complexes = NDArray[np.complex64]


@dataclass(frozen=True, slots=True)
class PlaceDescriptor:
    """Descriptor of a place: its walls, and transforms for rotation and shift.

    Parameters
    ----------
    middle_m : (2,) float64
        Middle of the image, in the place's frame [m].
    walls_m : (M, 2) float64
        One return per cell, from the middle [m].
    ring_transforms : (R, H) complex64
        Transform, along each ring, of the logarithmic magnitude spectrum.
    image_transform : (S, S // 2 + 1) complex64
        Transform of the image, of unit energy.
    """

    middle_m: Floats
    walls_m: Floats
    ring_transforms: Complexes
    image_transform: Complexes


@dataclass(frozen=True, slots=True)
class PlaceMatch:
    """A similar place with its relative pose.

    Parameters
    ----------
    place : int
    place_from_query : (3,) float64
        Pose of the query's frame in that place's, if both are the same place [m, m, rad].
    correlation : float
        Normalised cross-correlation of the images, 0 to 1.
    """

    place: int
    place_from_query: Floats
    correlation: float


def describe_place(points: Floats, middle_m: Floats) -> PlaceDescriptor:
    """Describe a place by its returns (K, 2) [m] around a middle (2,) [m] of its frame."""
    centered = points - middle_m
    walls = one_per_cell(
        centered[np.hypot(centered[:, 0], centered[:, 1]) < _REACH_M], _RING_CELL_M
    )
    image = _rasterised(walls, _SHIFT_CELL_M, _SHIFT_SIDE)
    energy = max(float(np.linalg.norm(image)), 1e-12)
    transform = np.asarray(rfft2(image / energy), dtype=np.complex64)
    return PlaceDescriptor(middle_m, walls, _spectrum_on_rings(walls), transform)


class PlaceIndex:
    """Database of place descriptors, queried for the most similar ones."""

    def __init__(self, descriptors: Sequence[PlaceDescriptor]) -> None:
        self._descriptors = descriptors
        self._rings = np.array([place.ring_transforms for place in descriptors])

    def most_similar(
        self, query: int, candidates: NDArray[np.int64], limit: int
    ) -> list[PlaceMatch]:
        """Return the most similar places with relative poses, the highest correlation first.

        Parameters
        ----------
        query : int
        candidates : (A,) int64
            Places that are compared with it.
        limit : int
            Places whose images are correlated (two rotations each).
        """
        query_descriptor = self._descriptors[query]
        product = np.einsum(
            "rh,arh->ah", np.conj(query_descriptor.ring_transforms), self._rings[candidates]
        )
        correlation_by_turn = np.fft.irfft(product, n=_ANGLES, axis=1)
        likeliest = np.argsort(-correlation_by_turn.max(axis=1))[:limit]
        turns = np.pi * np.argmax(correlation_by_turn[likeliest], axis=1) / _ANGLES
        places = np.repeat(candidates[likeliest], len(_HALF_TURNS)).tolist()
        orientations = zip(places, np.add.outer(turns, _HALF_TURNS).ravel().tolist(), strict=True)
        matches = _best_shifts(
            query_descriptor,
            [(place, self._descriptors[place], turn) for place, turn in orientations],
        )
        return sorted(matches, key=lambda f: -f.correlation)


def _rotated_transform(walls: Floats, turn_rad: float) -> tuple[Complexes, float]:
    """Conjugate transform of the image of rotated walls (M, 2) [m], and its energy."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    image = _rasterised(walls @ np.array([[c, s], [-s, c]]), _SHIFT_CELL_M, _SHIFT_SIDE)
    return np.conj(rfft2(image)), max(float(np.linalg.norm(image)), 1e-12)


def _best_shifts(
    query: PlaceDescriptor, orientations: Sequence[tuple[int, PlaceDescriptor, float]]
) -> list[PlaceMatch]:
    """Find the shifts of highest correlation of a place, rotated by angles [rad], with others."""
    rotated = cache(partial(_rotated_transform, query.walls_m))
    products = np.array(
        [other.image_transform * rotated(turn_rad)[0] for _, other, turn_rad in orientations]
    )
    correlations = irfft2(products, s=(_SHIFT_SIDE, _SHIFT_SIDE)).reshape(len(orientations), -1)
    peaks = np.argmax(correlations, axis=1)
    half = _SHIFT_SIDE // 2
    row, col = ((k + half) % _SHIFT_SIDE - half for k in np.divmod(peaks, _SHIFT_SIDE))
    middles = np.array([other.middle_m for _, other, _ in orientations])
    shifted = middles + np.column_stack([col, row]) * _SHIFT_CELL_M
    headings = wrap_angles([turn_rad for *_, turn_rad in orientations])
    poses = compose(np.column_stack([shifted, headings]), np.array([*-query.middle_m, 0.0]))
    return [
        PlaceMatch(place, pose, float(best) / rotated(turn_rad)[1])
        for (place, _, turn_rad), pose, best in zip(
            orientations, poses, correlations[np.arange(len(orientations)), peaks], strict=True
        )
    ]


def _rasterised(walls: Floats, cell_m: float, side: int) -> NDArray[np.float32]:
    image = _occupancy(walls, cell_m, side)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), _BLUR_CELLS), dtype=np.float32)


@kernel
def _occupancy(walls: Floats, cell_m: float, side: int) -> NDArray[np.float32]:
    """Binary image (side, side) of walls (M, 2) [m]."""
    image = np.zeros((side, side), dtype=np.float32)
    for k in range(len(walls)):
        col = math.floor(walls[k, 0] / cell_m) + side // 2
        row = math.floor(walls[k, 1] / cell_m) + side // 2
        if 0 <= col < side and 0 <= row < side:
            image[row, col] = 1.0
    return image


def _spectrum_on_rings(walls: Floats) -> Complexes:
    image = _rasterised(walls, _RING_CELL_M, _RING_SIDE)
    spectrum = np.fft.fftshift(np.abs(np.fft.fft2(image))).astype(np.float32)
    columns, rows = _rings()
    sampled = np.log1p(cv2.remap(spectrum, columns, rows, cv2.INTER_LINEAR))
    sampled -= sampled.mean(axis=1, keepdims=True)
    sampled /= max(float(np.linalg.norm(sampled)), 1e-12)
    return np.asarray(np.fft.rfft(sampled, axis=1), dtype=np.complex64)


@cache
def _rings() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where the spectrum is sampled: columns and rows (rings, angles)."""
    angles = np.pi * np.arange(_ANGLES) / _ANGLES
    radii = np.linspace(2.0, _RING_SIDE / 6.0, _RINGS)[:, None]
    columns = _RING_SIDE // 2 + radii * np.cos(angles)
    rows = _RING_SIDE // 2 + radii * np.sin(angles)
    return columns.astype(np.float32), rows.astype(np.float32)
