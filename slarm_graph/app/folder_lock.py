# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A lock on a folder: one process at a time works in it."""

from __future__ import annotations

import os
import weakref
from pathlib import Path

from slarm_graph.errors import BadInput

try:
    import fcntl
except ImportError:  # Windows: folders are not locked there
    fcntl = None  # type: ignore[assignment]


class FolderLock:
    """An exclusive lock on a folder, held while this object lives.

    The system releases it when the process ends, however it ends; there is no lock file.

    Parameters
    ----------
    path : Path
        An existing folder.

    Raises
    ------
    BadInput
        When another process holds the lock.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor: int | None = None
        if fcntl is None:
            return
        descriptor = os.open(path, os.O_RDONLY)
        weakref.finalize(self, os.close, descriptor)
        self._descriptor = descriptor
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BadInput(
                f"another process is at work in {path}; wait for it, or choose another --name"
            ) from None
        except OSError:  # a file system without locks
            pass

    def is_at(self, path: Path) -> bool:
        """Whether the locked folder is still found under its path."""
        if self._descriptor is None:
            return path.is_dir()
        try:
            return os.path.samestat(os.fstat(self._descriptor), path.stat())
        except OSError:
            return False
