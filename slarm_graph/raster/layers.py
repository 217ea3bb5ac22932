# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Layers of large sites, on disk, so that memory holds what is worked on and no more.

A layer is an array like any other. One that is large lies in a file without a name, which is gone
with the array or the process; its pages come into memory when they are touched, and leave it when
the layer is set aside.
"""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Scalar

_LARGE_BYTES = 1 << 25
"""A building of 100 x 200 m in single precision. With half, the same layers of a clinic
of 48 million cells are on disk; with double, those of a byte a cell stay in memory."""


def new_layer(shape: Sequence[int], dtype: type[Scalar]) -> NDArray[Scalar]:
    """Return an array of zeros, on disk where it is large and there is room."""
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    if size >= _LARGE_BYTES and sys.platform == "linux":
        with suppress(OSError):
            return np.ndarray(tuple(shape), dtype, buffer=_on_disk(size))
    return np.zeros(shape, dtype=dtype)


def _on_disk(size: int) -> mmap.mmap:
    """Map a new file of so many zeros [bytes], whose room on the disk is taken at once."""
    with tempfile.TemporaryFile() as file:
        os.posix_fallocate(file.fileno(), 0, size)
        return mmap.mmap(file.fileno(), size)


def set_aside(*layers: NDArray[np.generic]) -> None:
    """Let layers leave the memory until they are touched again; arrays not on disk stay."""
    for layer in layers:
        base: object = layer
        while isinstance(base, np.ndarray):
            base = base.base
        if isinstance(base, memoryview):
            base = base.obj
        if isinstance(base, mmap.mmap) and sys.platform == "linux":
            base.madvise(mmap.MADV_DONTNEED)
