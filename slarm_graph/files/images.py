# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounded reading of map images: PGM and PPM exactly, other formats by OpenCV."""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.grid import Mask

MAX_PIXELS = 100_000_000
"""Most pixels: 500 x 500 m at 0.05 m; the probabilities of so many cells take 400 MB. Twice as
many would pass 1 GB with what is computed beside them."""
MAX_TEXT_SHADES = 4_000_000
"""Most pixels of a text format: numbers as text take 50 bytes each while they are read, 200 MB."""
_MAX_FILE_BYTES = 6 * MAX_PIXELS + 4096
"""Largest file: so many pixels of three channels of two bytes."""
_PNM = re.compile(rb"P([2356])((?:\s|#[^\n]*\n)+)")
_NUMBER = re.compile(rb"(?:\s|#[^\n]*\n)*(\d{1,9})(?!\d)")
_MAX_SHADE = 65535
"""Largest maxval of the PNM format."""


@dataclass(frozen=True, slots=True)
class Image:
    """Shades of an image.

    Parameters
    ----------
    shades : (rows, cols) unsigned integers, or float64 for the mean of several colours
        The first row is the top of the image; 0 is black.
    full : int
        The shade of white.
    opaque : (rows, cols) bool or None
        Which pixels are not transparent; None when all are.
    """

    shades: NDArray[np.generic]
    full: int
    opaque: Mask | None = None


def read_image(path: Path) -> Image:
    """Read a map's image.

    Raises
    ------
    BadInput
        When it is missing, damaged, of an unknown kind or too large.
    """
    try:
        if not path.is_file():
            raise BadInput(f"no such file: {path} (the map's image)")
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise BadInput(f"{path}: {path.stat().st_size / 1e6:.0f} MB are no map's image")
        data = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror})") from None
    return _pnm(path, data) if _PNM.match(data) else _by_opencv(path, data)


def _bounded(path: Path, cols: int, rows: int) -> None:
    """Raise BadInput for an image that would not fit into memory, before reading it."""
    if cols < 1 or rows < 1 or cols * rows > MAX_PIXELS:
        raise BadInput(
            f"{path}: {cols} x {rows} pixels; a map has 1 to {MAX_PIXELS:,}:"
            " crop it or choose a coarser resolution"
        )


def _pnm(path: Path, data: bytes) -> Image:
    """Read PGM and PPM, binary and text; OpenCV leaves shades as they are when maxval is not 255.

    Format: https://netpbm.sourceforge.net/doc/pgm.html.
    """
    start = _PNM.match(data)
    assert start is not None
    kind, at, numbers = int(start[1]), start.end(), []
    for _ in range(3):
        found = _NUMBER.match(data, at)
        if found is None:
            raise BadInput(f"{path}: the header of the image is damaged")
        numbers.append(int(found[1]))
        at = found.end()
    cols, rows, full = numbers
    _bounded(path, cols, rows)
    if not 0 < full <= _MAX_SHADE:
        raise BadInput(f"{path}: maxval {full} of the image is not 1 to {_MAX_SHADE}")
    count = rows * cols * (3 if kind in (3, 6) else 1)
    values = _samples(path, data, at, count, full, as_text=kind in (2, 3))
    if int(values.max()) > full:
        raise BadInput(f"{path}: a shade of {int(values.max())} although maxval is {full}")
    if kind in (2, 5):
        return Image(values.reshape(rows, cols), full)
    return Image(values.reshape(rows, cols, 3).mean(axis=2), full)


def _samples(
    path: Path, data: bytes, at: int, count: int, full: int, *, as_text: bool
) -> NDArray[np.generic]:
    kind = np.dtype(np.uint8 if full < 256 else ">u2")
    size = (len(data) - at) // 2 if as_text else (len(data) - at - 1) // kind.itemsize
    if size < count:
        raise BadInput(f"{path}: the image ends early: {max(size, 0)} of {count} shades")
    if as_text and count > MAX_TEXT_SHADES:
        raise BadInput(f"{path}: {count:,} shades as text; save the image as binary PGM (P5)")
    if not as_text:
        return np.frombuffer(data, kind, count, at + 1).astype(kind.newbyteorder("="))
    words = data[at:].split(None, count)[:count]
    if len(words) < count or not all(word.isdigit() and len(word) < 6 for word in words):
        raise BadInput(f"{path}: the image's shades are damaged")
    return np.array(words, np.uint32)


def _by_opencv(path: Path, data: bytes) -> Image:
    _bounded(path, *_size(path, data))
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise BadInput(f"{path}: not an image that can be read")
    if image.dtype not in (np.uint8, np.uint16):
        raise BadInput(f"{path}: shades of type {image.dtype}; 8 or 16 bits are read")
    full = 255 if image.dtype == np.uint8 else 65535
    if image.ndim == 2:
        return Image(image, full)
    has_alpha = image.shape[2] in (2, 4)
    colours = image[..., :-1] if has_alpha else image
    return Image(colours.mean(axis=2), full, image[..., -1] >= full if has_alpha else None)


def _size(path: Path, data: bytes) -> tuple[int, int]:
    """Return columns and rows from the header; OpenCV allocates whatever a header claims."""
    import PIL.Image  # takes longer to import than this module is needed for PGM

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large images, which are told off by `_bounded`
            with PIL.Image.open(io.BytesIO(data)) as header:
                cols, rows = header.size
    except Exception:  # whatever Pillow meets in a damaged header
        raise BadInput(f"{path}: not an image that can be read") from None
    return cols, rows
