# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Process settings that save memory and time: malloc, huge pages, garbage collector, numba."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

_LINUX: Final = sys.platform == "linux"
_MMAP_THRESHOLD: Final = -3
"""M_MMAP_THRESHOLD of the GNU C library's malloc.h."""
_TRIM_THRESHOLD: Final = -1
"""M_TRIM_THRESHOLD of the same."""
_LARGE_BYTES: Final = 1 << 17
"""Blocks of this size and more are mapped one by one: the library's own threshold, which it raises
with what is freed, to 32 MB, so that memory between smaller blocks never goes back. With half or
double of this a whole run takes the same memory and time."""
_LAYER_BYTES: Final = 1 << 22
"""The same where layers of a band of rows (2 MB) are made one after the other: their pages, mapped
anew for each, were half of the system's time after SLAM, 4.9 s of a clinic and 2.5 s here. With
four times as much 2.1 s, and 60 MB more; over a whole run 20 MB more of a small recording."""
_KEPT_BYTES: Final = 1 << 24
"""Free memory at the heap's end that meanwhile is kept for the next allocations: some layers. With
four times as much a clinic takes 30 MB more, and no less time."""
_THP_DISABLE: Final = 41
"""PR_SET_THP_DISABLE of the kernel's prctl.h. Layers of large sites are mostly zeros that nobody
writes, and take no memory in small pages; in huge ones, which numpy asks for, they take all."""
_DONT_NEED: Final = 4
"""MADV_DONTNEED of the kernel's mman.h."""


def return_freed() -> None:
    """Return freed memory and pages that files hold (code that ran once, layers); Linux only.

    Of a library of 180 MB such as LLVM 70 are read to start it and to load the first kernel, hardly
    any ever after. What is used again is mapped again from the system's cache of files.
    """
    if not _LINUX:
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "malloc_trim"):
        library.malloc_trim(0)
    for start, size in _held_by_files():
        library.madvise(ctypes.c_void_p(start), ctypes.c_size_t(size), _DONT_NEED)


def _held_by_files() -> Iterator[tuple[int, int]]:
    """Yield start and size [bytes] of every mapping whose pages can be read again from its file.

    These are read-only and executable mappings of libraries, unless pages have become the process's
    own (as those of relocated tables), in memory or swapped out; and layers on disk, which are
    shared with their file.
    """
    try:
        lines = Path("/proc/self/smaps").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return
    found: tuple[int, int] | None = None
    for line in lines:
        key, _, rest = line.partition(" ")
        if not key.endswith(":"):
            first, past = (int(edge, 16) for edge in key.split("-"))
            library = rest.startswith(("r-xp", "r--p")) and ".so" in rest
            layer = rest.startswith("rw-s") and rest.endswith("(deleted)")
            found = (first, past - first) if library or layer else None
        elif found is not None and key in ("Anonymous:", "Swap:"):
            if rest.split()[0] != "0":
                found = None
            elif key == "Swap:":  # comes last of the two
                yield found


def configure_allocator() -> None:
    """Use small pages, and return large arrays when they are freed; GNU C library only."""
    if not _LINUX:
        return
    library = ctypes.CDLL(None)
    _map_from(_LARGE_BYTES, _LARGE_BYTES)
    if hasattr(library, "prctl"):
        library.prctl(_THP_DISABLE, 1, 0, 0, 0)


@contextmanager
def keep_freed_layers() -> Iterator[None]:
    """Keep freed pages for the layers made next, while the block runs; GNU C library only."""
    _map_from(_LAYER_BYTES, _KEPT_BYTES)
    try:
        yield
    finally:
        _map_from(_LARGE_BYTES, _LARGE_BYTES)


def _map_from(least: int, kept: int) -> None:
    """Set malloc's mmap threshold and the free memory kept at the heap's end [bytes]."""
    if not _LINUX:
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, least)
        library.mallopt(_TRIM_THRESHOLD, kept)
        library.malloc_trim(0)


def freeze_garbage_collector() -> None:
    """Exclude all present objects (modules, functions) from garbage collection.

    They live to the end. The collector went over all of them, 200,000 objects in 0.1 s, whenever
    there were a quarter more objects: eleven times after SLAM on a clinic.
    """
    gc.freeze()


def disable_error_highlighting() -> None:
    """Keep numba from colouring messages of failed type inference; call before numba is imported.

    Compilation makes thousands of such messages and shows none. Of some kernels that was a seventh
    of the processor time of compiling them, of others nothing measurable.
    """
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
