# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of places and their spectra against plain Fourier transforms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from slarm_graph.frontends.scans.place_recognition import (
    PlaceDescriptor,
    PlaceIndex,
    describe_place,
)
from slarm_graph.geometry import Floats, Pose2, wrap_angles

MIDDLE = np.array([3.0, -2.0])


def walls_of(seed: int) -> Floats:
    """Returns on some random walls within 25 m and more of a middle."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-16.0, 16.0, (12, 2))
    ways = rng.uniform(-12.0, 12.0, (12, 2))
    at = np.linspace(0.0, 1.0, 200)
    return np.concatenate([end + at[:, None] * way for end, way in zip(ends, ways, strict=True)])


def drawn(walls: Floats, cell_m: float, side: int) -> Floats:
    """Cells with walls, blurred by one cell; mirrored at the edge, cut off at four."""
    edges = (np.arange(side + 1) - side // 2) * cell_m
    counts = np.histogram2d(walls[:, 1], walls[:, 0], (edges, edges))[0]
    return np.asarray(gaussian_filter((counts > 0).astype(float), 1.0, mode="mirror", truncate=4.0))


@pytest.mark.parametrize("seed", range(3))
def test_a_place_is_its_picture_and_rings_of_its_spectrum(seed: int) -> None:
    points = walls_of(seed) + MIDDLE
    looks = describe_place(points, MIDDLE)
    away = points - MIDDLE
    near = away[np.hypot(*away.T) < 20.0]
    cells = {tuple(cell) for cell in np.floor(near / 0.25).astype(int).tolist()}
    kept = np.floor(looks.walls_m / 0.25).astype(int).tolist()
    assert len(kept) == len(cells)
    assert {tuple(cell) for cell in kept} == cells
    picture = drawn(looks.walls_m, 0.5, 96)
    expected = np.fft.rfft2(picture / np.linalg.norm(picture))
    np.testing.assert_allclose(looks.image_transform, expected, atol=2e-5)
    spectrum = np.fft.fftshift(np.abs(np.fft.fft2(drawn(looks.walls_m, 0.25, 192))))
    angles, radii = np.pi * np.arange(96) / 96, np.linspace(2.0, 32.0, 30)[:, None]
    at = [96 + radii * np.sin(angles), 96 + radii * np.cos(angles)]
    rings = np.log1p(map_coordinates(spectrum, at, order=1))
    rings -= rings.mean(axis=1, keepdims=True)
    expected = np.fft.rfft(rings / np.linalg.norm(rings), axis=1)
    # Places between two cells are rounded to a thirty-second of one.
    assert np.linalg.norm(looks.ring_transforms - expected) < 0.02 * np.linalg.norm(expected)


def moved(points: Floats, pose: Pose2) -> PlaceDescriptor:
    """How a place looks around a point beside its origin, which has a pose among the points."""
    middle = pose.inverse().transform(np.array([0.5, 1.0]))
    return describe_place(np.asarray(pose.inverse().transform(points)), middle)


@pytest.mark.parametrize("turn_deg", [0.0, 50.0, 100.0, 175.0, -60.0, -120.0])
def test_a_place_is_found_among_others_as_it_lies(turn_deg: float) -> None:
    """Pose, place, and a likeness of nearly one; the other way round it is less alike."""
    pose = Pose2(2.0, -1.5, math.radians(turn_deg))
    places = [moved(walls_of(k), Pose2()) for k in range(5)]
    index = PlaceIndex([*places, moved(walls_of(3), pose)])
    found = index.most_similar(5, np.array([1, 4, 3, 0]), 2)
    assert [f.correlation for f in found] == sorted((f.correlation for f in found), reverse=True)
    assert len(found) == 4
    best, likely = found[0], [f.place for f in found].count(3)
    assert (best.place, likely) == (3, 2)
    assert best.correlation > 0.6
    assert max(f.correlation for f in found[1:]) < best.correlation - 0.2
    off = best.place_from_query - pose.as_array()
    assert np.abs(off[:2]).max() < 0.6
    assert abs(wrap_angles(off[2])) < math.radians(2.5)
    same = index.most_similar(3, np.array([3]), 1)[0]
    assert same.correlation == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(same.place_from_query, 0.0, atol=1e-9)


def test_nothing_looks_like_nothing() -> None:
    empty = describe_place(np.zeros((0, 2)), np.zeros(2))
    index = PlaceIndex([empty, moved(walls_of(0), Pose2())])
    assert all(abs(f.correlation) < 1e-6 for f in index.most_similar(0, np.array([0, 1]), 2))
