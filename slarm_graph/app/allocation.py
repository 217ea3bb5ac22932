# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a stage frees goes back to the system, and not only to the next stage."""

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


def return_freed() -> None:
    """Return what has been freed between blocks that are still in use; GNU libraries only."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if _LINUX else None
    if malloc_trim is not None:
        malloc_trim(0)


def return_large_blocks() -> None:
    """Have large arrays of this process returned to the system when freed; GNU libraries only."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if _LINUX else None
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
