# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounded reading of array archives (`.npz`): sizes are checked before memory is taken."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from slarm_graph.errors import BadInput, brief

MAX_ARRAY_BYTES = 1 << 29
"""512 MB of one archive's arrays: the radio map of ten access points over 300 x 300 m at 0.05 m
takes 1.8 GB as float32, but such maps are split; what is larger would not fit beside the run."""
FAILURES = (
    OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, NotImplementedError,
    MemoryError, zipfile.BadZipFile, zlib.error, SyntaxError, UnicodeError, OverflowError,
)  # fmt: skip
"""Exceptions of zipfile, zlib and numpy for damaged archives."""


def read_arrays(path: Path, what: str) -> Mapping[str, NDArray[Any]]:
    """Read every array of an archive; object arrays, which can hold code, are refused.

    Parameters
    ----------
    path : Path
    what : str
        Expected content, for messages.

    Raises
    ------
    BadInput
        When it is missing, damaged, or larger than `MAX_ARRAY_BYTES`.
    """
    with arrays_of(path, what) as arrays:
        return arrays


@contextmanager
def arrays_of(path: Path, what: str) -> Iterator[Mapping[str, NDArray[Any]]]:
    """Yield the arrays of `read_arrays`; errors in the block are reported as those of the file."""
    try:
        yield load_arrays(path, MAX_ARRAY_BYTES)
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except FAILURES as error:
        raise BadInput(f"{path}: not {what} written by slarm ({brief(str(error))})") from None


def load_arrays(path: Path, at_most: int) -> Mapping[str, NDArray[Any]]:
    """Read every array of an archive of at most so many bytes; `FAILURES` come through."""
    with zipfile.ZipFile(path) as archive:
        total = sum(info.file_size for info in archive.infolist())
        if total > at_most:
            raise ValueError(f"{total / 1e6:.0f} MB are too large")
        return {
            info.filename.removesuffix(".npy"): _array(archive.read(info), at_most)
            for info in archive.infolist()
        }


def _array(data: bytes, at_most: int) -> NDArray[Any]:
    """Read one array; raise for one that claims more data than there are, or Python objects."""
    found = npy.read_array(io.BytesIO(data), allow_pickle=False)
    if found.size > at_most:
        raise ValueError("an array of nothing claims to be large")
    return np.asarray(found)
