# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps written are read back identically by a reader that knows only nav2's rules."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.files.images import read_image
from slarm_graph.files.maps import read_map, write_map
from slarm_graph.grid import GridGeometry, OccupancyGrid


def nav2_cells(path: Path) -> tuple[NDArray[np.int8], list[float], float]:
    """Read a map as nav2's map_server does, pixel by pixel and without our code or OpenCV.

    Returns cells (rows, cols) of -1, 0 ... 100 with row 0 at the origin, origin and resolution.
    """
    info = yaml.safe_load(path.read_text())
    data = (path.parent / info["image"]).read_bytes()
    magic, size, maxval, pixels = data.split(b"\n", 3)
    assert (magic, maxval) == (b"P5", b"255")
    cols, rows = (int(word) for word in size.split())
    assert len(pixels) == rows * cols
    cells = np.full((rows, cols), -1, dtype=np.int8)
    for index, value in enumerate(pixels):
        row, col = rows - 1 - index // cols, index % cols
        p = value / 255.0 if info["negate"] else (255 - value) / 255.0
        if p >= info["occupied_thresh"]:
            cells[row, col] = 100
        elif p <= info["free_thresh"]:
            cells[row, col] = 0
    return cells, info["origin"], info["resolution"]


def save(folder: Path, grid: OccupancyGrid) -> Path:
    path = folder / "map.yaml"
    write_map(path, grid)
    return path


def corner_grid() -> OccupancyGrid:
    """A wall along the lowest row, one free cell to its upper left, everything else unknown."""
    p = np.full((4, 6), np.nan, dtype=np.float32)
    p[0, :] = 1.0
    p[3, 0] = 0.0
    return OccupancyGrid(GridGeometry(-1.0, 2.0, 0.05, 4, 6), p)


def test_nothing_is_mirrored_and_unknown_stays_unknown(tmp_path: Path) -> None:
    cells, origin, resolution = nav2_cells(save(tmp_path, corner_grid()))
    assert (cells[0] == 100).all()
    assert cells[3, 0] == 0
    assert (cells == -1).sum() == 24 - 6 - 1
    assert (origin, resolution) == ([-1.0, 2.0, 0.0], 0.05)


def test_shades_are_those_of_nav2s_map_saver(tmp_path: Path) -> None:
    """254 free, 0 occupied, 205 unknown, also for readers that go by shades and not thresholds."""
    save(tmp_path, corner_grid())
    pixels = (tmp_path / "map.pgm").read_bytes()[-24:]
    image = np.frombuffer(pixels, np.uint8).reshape(4, 6)
    assert image[0].tolist() == [254] + [205] * 5
    assert (image[1:3] == 205).all()
    assert (image[3] == 0).all()


numbers = st.floats(-1e4, 1e4, allow_nan=False, allow_infinity=False)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 9), st.integers(1, 9), numbers, numbers, st.floats(1e-6, 10), st.integers(0, 99)
)
def test_two_readers_agree(
    tmp_path_factory: pytest.TempPathFactory,
    rows: int,
    cols: int,
    x: float,
    y: float,
    resolution: float,
    seed: int,
) -> None:
    cells = np.random.default_rng(seed).choice([0.0, 1.0, np.nan], (rows, cols))
    grid = OccupancyGrid(GridGeometry(x, y, resolution, rows, cols), cells.astype(np.float32))
    path = save(tmp_path_factory.mktemp("map"), grid)
    theirs, origin, their_resolution = nav2_cells(path)
    ours = read_map(path)
    assert ours.geometry == grid.geometry
    assert (origin[0], origin[1], their_resolution) == (x, y, resolution)
    assert np.array_equal(ours.probability, grid.probability, equal_nan=True)
    assert np.array_equal(theirs, np.nan_to_num(grid.probability, nan=-0.01) * 100)


def described(folder: Path, pixels: NDArray[np.uint8], **changes: object) -> Path:
    """Write an image as PNG with a YAML that differs from the usual one by some keys."""
    cv2.imwrite(str(folder / "m.png"), pixels)
    keys = {
        "image": "m.png",
        "resolution": 0.1,
        "origin": [0.0, 0.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    } | changes
    path = folder / "m.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in keys.items() if v is not None}))
    return path


def test_scale_and_raw_maps_follow_nav2(tmp_path: Path) -> None:
    image = np.arange(256, dtype=np.uint8)[None, :]
    scale = read_map(described(tmp_path, image, mode="scale")).probability[0]
    raw = read_map(described(tmp_path, image, mode="raw")).probability[0]
    for value in range(256):
        p = (255 - value) / 255
        between = round(100 * (p - 0.196) / (0.65 - 0.196)) / 100
        expected = 1.0 if p >= 0.65 else 0.0 if p <= 0.196 else between
        assert scale[value] == pytest.approx(expected, abs=1e-6)
        assert (
            (raw[value] == pytest.approx(value / 100)) if value <= 100 else math.isnan(raw[value])
        )


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_a_shade_just_at_a_threshold_is_decided_as_nav2_does(tmp_path: Path, mode: str) -> None:
    """Thresholds belong to the class on their far side: p >= occupied, p <= free."""
    image = np.array([[0, 63, 64, 65, 127, 128, 129, 255]], dtype=np.uint8)
    shades = {"occupied_thresh": 128 / 255, "free_thresh": 64 / 255, "negate": 1, "mode": mode}
    found = read_map(described(tmp_path, image, **shades)).probability[0]
    assert (found[[0, 1, 2]] == 0.0).all()
    assert (found[[5, 6, 7]] == 1.0).all()
    between = found[[3, 4]]
    assert np.isnan(between).all() if mode == "trinary" else ((between > 0) & (between < 1)).all()


def test_negated_coloured_and_transparent_images(tmp_path: Path) -> None:
    dark = np.zeros((1, 2), dtype=np.uint8)
    assert (read_map(described(tmp_path, dark, negate=1)).probability == 0).all()
    pixels = np.array([[[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 0, 10]]], dtype=np.uint8)
    cells = read_map(described(tmp_path, pixels)).probability[0]
    assert cells[:2].tolist() == [1, 0]
    assert math.isnan(cells[2])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"resolution": None}, "missing key 'resolution'"),
        ({"origin": [0, 0]}, "'origin' should have 3 elements"),
        ({"origin": [0, 0, 0.1]}, "only yaw 0"),
        ({"origin": [0, math.nan, 0]}, "'origin' is not finite"),
        ({"free_thresh": 0.7}, "0 <= free_thresh < occupied_thresh <= 1"),
        ({"resolution": "fine"}, "'resolution' is not a number"),
        ({"resolution": -1}, "resolution must be positive"),
        ({"mode": "colour"}, "none of trinary, scale, raw"),
        ({"image": "nowhere.png"}, "no such file"),
    ],
)
def test_names_what_is_wrong(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        read_map(described(tmp_path, np.zeros((1, 1), dtype=np.uint8), **changes))


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([2, 3, 5, 6]), st.integers(1, 4), st.integers(1, 4),
    st.sampled_from([1, 9, 255, 256, 65535]), st.integers(0, 99),
)  # fmt: skip
def test_all_kinds_of_pnm_are_read_shade_by_shade(
    tmp_path_factory: pytest.TempPathFactory, kind: int, rows: int, cols: int, full: int, seed: int
) -> None:
    """Colours become their mean, and nothing is lost to the number of bits."""
    colours = 3 if kind in (3, 6) else 1
    shades = np.random.default_rng(seed).integers(0, full + 1, (rows, cols, colours))
    wide = shades.astype(">u2" if full > 255 else np.uint8).tobytes()
    body = " ".join(map(str, shades.ravel())).encode() if kind < 4 else wide
    path = tmp_path_factory.mktemp("pnm") / "m.pnm"
    head = f"P{kind}\n{cols} {rows}\n{full}".encode()
    path.write_bytes(head + b"\n" + body)
    image = read_image(path)
    assert (image.full, image.opaque) == (full, None)
    np.testing.assert_allclose(image.shades, shades.mean(axis=2), rtol=1e-12)
    path.write_bytes(head)
    with pytest.raises(BadInput, match=f"early: 0 of {shades.size} shades"):
        read_image(path)


@pytest.mark.parametrize("shape", [(3, 4), (3, 4, 3), (3, 4, 4)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_png_is_read_shade_by_shade(
    tmp_path: Path, shape: tuple[int, ...], kind: type[np.unsignedinteger]
) -> None:
    full = int(np.iinfo(kind).max)
    pixels = np.random.default_rng(0).integers(0, full + 1, shape).astype(kind)
    pixels[0, ..., -1] = full
    cv2.imwrite(str(tmp_path / "m.png"), pixels)
    image = read_image(tmp_path / "m.png")
    assert image.full == full
    if len(shape) == 2:
        np.testing.assert_array_equal(image.shades, pixels)
    else:
        np.testing.assert_allclose(image.shades, pixels[..., :3].mean(axis=2))
    if shape[-1] == 4 and len(shape) == 3:
        np.testing.assert_array_equal(image.opaque, pixels[..., 3] == full)
    else:
        assert image.opaque is None


@pytest.mark.parametrize("full", [1, 100, 254, 255, 256, 1000, 65535])
@pytest.mark.parametrize("as_text", [True, False])
def test_shades_are_scaled_by_maxval(tmp_path: Path, full: int, as_text: bool) -> None:
    shades = np.array([[0, full // 2, full]])
    head = f"P{2 if as_text else 5} # a comment\n3 1\n{full}\n".encode()
    wide = shades.astype(">u2" if full > 255 else np.uint8).tobytes()
    body = " ".join(map(str, shades[0])).encode() if as_text else wide
    (tmp_path / "m.pgm").write_bytes(head + body)
    path = described(tmp_path, np.zeros((1, 1), np.uint8), image="m.pgm", mode="scale")
    got = read_map(path).probability[0]
    middle = 1.0 - (full // 2) / full
    between = 1.0 if middle >= 0.65 else round((middle - 0.196) / (0.65 - 0.196), 2)
    assert got.tolist() == pytest.approx([1.0, between, 0.0], abs=1e-6)


def test_numbers_in_quotes_truth_values_and_a_yaw_that_is_nan(tmp_path: Path) -> None:
    dark = np.zeros((1, 2), dtype=np.uint8)
    for value, occupied in (("0", True), ("1", False), (False, True), (True, False), (0.0, True)):
        assert read_map(described(tmp_path, dark, negate=value)).occupied.all() == occupied
    for yaw in ("-nan", math.nan, "nan"):
        assert read_map(described(tmp_path, dark, origin=[1, 2, yaw])).geometry.origin_y_m == 2.0


def test_an_image_that_has_moved_with_its_map_is_found(tmp_path: Path) -> None:
    path = described(tmp_path, np.zeros((1, 2), np.uint8), image="/home/someone/maps/m.png")
    assert read_map(path).occupied.all()


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (b"P5 1000000 1000000 255 ", "1000000 x 1000000 pixels"),
        (b"P5 0 3 255 ", "0 x 3 pixels"),
        (b"P5 2 2 255 abc", "ends early: 3 of 4 shades"),
        (b"P5 2 2 0 abcd", "maxval 0"),
        (b"P5 2 2 70000 abcd", "maxval 70000"),
        (b"P2 2 1 9 3 99", "a shade of 99 although maxval is 9"),
        (b"P2 2 1 255 3 x", "shades are damaged"),
        (b"P5 999999999999 2 255 ", "header of the image is damaged"),
        (b"hello", "not an image"),
    ],
)
def test_damaged_images(tmp_path: Path, image: bytes, words: str) -> None:
    path = described(tmp_path, np.zeros((1, 1), np.uint8), image="h.pgm")
    (tmp_path / "h.pgm").write_bytes(image)
    with pytest.raises(BadInput, match=words):
        read_map(path)


def test_an_image_that_claims_a_giant_size_is_not_decoded(tmp_path: Path) -> None:
    path = described(tmp_path, np.zeros((1, 1), np.uint8))
    png = bytearray((tmp_path / "m.png").read_bytes())
    png[16:24] = (2**20 - 1).to_bytes(4, "big") * 2
    (tmp_path / "m.png").write_bytes(png)
    with pytest.raises(BadInput, match=r"pixels|not an image"):
        read_map(path)


def test_real_map_of_gmapping_is_read(shared_data: Path) -> None:
    grid = read_map(shared_data / "robot_bags" / "all.yaml")
    assert grid.occupied.any()
    assert grid.free.any()
    assert grid.unknown.any()
