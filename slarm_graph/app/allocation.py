# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Memory is taken where it is written, and what a stage frees goes back to the system."""

from __future__ import annotations

import ctypes
import sys
from typing import Final

_LINUX: Final = sys.platform == "linux"
_MMAP_THRESHOLD: Final = -3
"""M_MMAP_THRESHOLD of the GNU C library's malloc.h."""
_LARGE_BYTES: Final = 1 << 17
"""Blocks from here on are mapped one by one: the library's own threshold, which it raises with what
is freed, to 32 MB, so that what lies between smaller blocks never goes back. With half or double of
this a whole run takes the same memory and time."""


_THP_DISABLE: Final = 41
"""PR_SET_THP_DISABLE of the kernel's prctl.h. Layers of large sites are mostly zeros that nobody
writes, and take no memory in small pages; in huge ones, which numpy asks for, they take all."""


def return_freed() -> None:
    """Return what has been freed between blocks that are still in use; GNU libraries only."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if _LINUX else None
    if malloc_trim is not None:
        malloc_trim(0)


def spare_memory() -> None:
    """Take memory in small pages, and return large arrays when freed; GNU libraries only."""
    if not _LINUX:
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
    if hasattr(library, "prctl"):
        library.prctl(_THP_DISABLE, 1, 0, 0, 0)
