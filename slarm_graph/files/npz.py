# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing of compressed `.npz` archives array by array, to save memory."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.files.zip_archive import Deflated, ZipArchive


@dataclass(frozen=True, slots=True)
class InParts:
    """An array that is generated while it is written, to save memory.

    Parameters
    ----------
    shape : tuple of int
    dtype : numpy.dtype
    parts : iterable of ndarray or int
        Consecutive pieces of its values; an integer stands for so many blank values.
    blank : float
        The value of blank cells.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    parts: Iterable[NDArray[np.generic] | int]
    blank: float = 0.0

    def write(self, file: Deflated) -> None:
        """Write it as an NPY file."""
        file.write(_header(self.dtype, self.shape))
        blank, begun = np.array(self.blank).astype(self.dtype).tobytes(), file.size
        for part in self.parts:
            if isinstance(part, int):
                file.repeat(blank, part)
            else:
                file.write(part.tobytes())
        size = math.prod(self.shape) * self.dtype.itemsize
        if file.size - begun != size:
            raise RuntimeError(f"{file.size - begun} bytes for an array of {size}")


def write_npz(path: Path, arrays: Iterable[tuple[str, ArrayLike | InParts]]) -> None:
    """Write named arrays that `numpy.load` reads; each is generated when its turn comes."""
    with path.open("wb") as file, ZipArchive(file) as archive:
        for name, values in arrays:
            with archive.file(f"{name}.npy") as entry:
                if isinstance(values, InParts):
                    values.write(entry)
                else:
                    whole = np.asanyarray(values, order="C")
                    entry.write(_header(whole.dtype, whole.shape))
                    entry.write(whole.tobytes())


def _header(dtype: np.dtype[np.generic], shape: tuple[int, ...]) -> bytes:
    """Return the header of an NPY file."""
    kind = np.lib.format.dtype_to_descr(dtype)
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        file, {"descr": kind, "fortran_order": False, "shape": shape}
    )
    return file.getvalue()
