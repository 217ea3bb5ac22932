# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Layers of large sites, on disk, so that memory holds what is worked on and no more.

A layer is an array like any other. One that is large lies in a file without a name, which is gone
with the array or the process; its pages come into memory when they are touched, and leave it when
the layer is set aside. One of which little will be written takes memory for that little alone,
whatever value the rest has.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Scalar
from slarm_graph.tiles import KnownTiles, Where

_LARGE_BYTES = 1 << 25
"""A building of 100 x 200 m in single precision. With half, the same layers of a clinic
of 48 million cells are on disk; with double, those of a byte a cell stay in memory."""
_LITTLE: Final = 0.25
"""A layer of which less will be written is not laid on disk: written pages hold up to four times
the cells of a tile's row that lie in them (1,024 of 4 bytes, 256 of a tile)."""
_BLANK_BYTES: Final = 1 << 22
"""Of the file that stands for what nobody writes; with half, a layer has twice the mappings, 800
for a square kilometre at 0.05 m of the 65,530 that Linux allows (vm.max_map_count)."""
_NO_RESERVE: Final = 0x4000
"""MAP_NORESERVE of the kernel's mman.h: what is never written is not asked for."""
_PRIVATE_FIXED: Final = 0x12
"""MAP_PRIVATE | MAP_FIXED of the kernel's mman.h; the second is not in Python's module."""


class _OnDisk(mmap.mmap):
    """A mapped file, whose pages may leave the memory at any time."""


def new_layer(
    shape: Sequence[int], dtype: type[Scalar], where: Where | None = None
) -> NDArray[Scalar]:
    """Return an array of zeros, on disk where it is large and there is room.

    Of few tiles it stays in memory, where zeros that nobody writes take none.
    """
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    if size >= _LARGE_BYTES and sys.platform == "linux" and not _is_little(where):
        with suppress(OSError):
            return np.ndarray(tuple(shape), dtype, buffer=_on_disk(size))
    return sparse_layer(shape, dtype) if _is_little(where) else np.zeros(shape, dtype=dtype)


def sparse_layer(shape: Sequence[int], dtype: type[Scalar]) -> NDArray[Scalar]:
    """Return an array of zeros of which little will be written: it may exceed the memory."""
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    if size >= _LARGE_BYTES and sys.platform == "linux":
        return np.ndarray(tuple(shape), dtype, buffer=_set_apart(size))
    return np.zeros(shape, dtype=dtype)


def _set_apart(size: int) -> mmap.mmap:
    """Set addresses apart for so many bytes; only what is written of them becomes memory."""
    return mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _NO_RESERVE)


def _is_little(where: Where | None) -> bool:
    """Whether little will be written of a layer."""
    return isinstance(where, KnownTiles) and where.share < _LITTLE


def blank_layer(shape: Sequence[int], where: Where | None) -> NDArray[np.float32]:
    """Return an array of nan; where little will be written, what stays nan takes no room."""
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(np.float32).itemsize
    if _is_little(where) and sys.platform == "linux":
        with suppress(OSError):
            return np.ndarray(tuple(shape), np.float32, buffer=_mostly_blank(size))
    layer = new_layer(shape, np.float32)
    flat = layer.reshape(-1)
    for start in range(0, flat.size, _LARGE_BYTES // 4):
        flat[start : start + _LARGE_BYTES // 4] = np.nan
        set_aside(layer)
    return layer


def _on_disk(size: int) -> mmap.mmap:
    """Map a new file of so many zeros [bytes], whose room on the disk is taken at once."""
    with tempfile.TemporaryFile() as file:
        os.posix_fallocate(file.fileno(), 0, size)
        return _OnDisk(file.fileno(), size)


def _mostly_blank(size: int) -> mmap.mmap:
    """Map a file of nan again and again, so many bytes; what is written becomes memory's own."""
    whole = _set_apart(size)
    place = ctypes.addressof(ctypes.c_char.from_buffer(whole))
    library = ctypes.CDLL(None, use_errno=True)
    library.mmap.restype = ctypes.c_void_p
    for start in range(0, size, _BLANK_BYTES):
        got = library.mmap(
            ctypes.c_void_p(place + start),
            ctypes.c_size_t(min(_BLANK_BYTES, size - start)),
            mmap.PROT_READ | mmap.PROT_WRITE,
            _PRIVATE_FIXED,
            _blank_file(),
            ctypes.c_long(0),
        )
        if got != place + start:
            raise OSError(ctypes.get_errno(), "no room for a layer")
    return whole


@cache
def _blank_file() -> int:
    """Open a file of nan without a name, for as long as the process lives."""
    with tempfile.TemporaryFile() as file:
        file.write(np.full(_BLANK_BYTES // 4, np.nan, dtype=np.float32).tobytes())
        file.flush()
        return os.dup(file.fileno())


def set_aside(*layers: NDArray[np.generic]) -> None:
    """Let layers leave the memory until they are touched again; arrays not on disk stay."""
    for layer in layers:
        base: object = layer
        while isinstance(base, np.ndarray):
            base = base.base
        if isinstance(base, memoryview):
            base = base.obj
        if isinstance(base, _OnDisk) and sys.platform == "linux":
            base.madvise(mmap.MADV_DONTNEED)
