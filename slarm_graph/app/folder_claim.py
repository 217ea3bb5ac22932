# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One process at a time works in a folder; one that has died holds nothing."""

from __future__ import annotations

import os
import weakref
from pathlib import Path

from slarm_graph.errors import BadInput

try:
    import fcntl
except ImportError:  # Windows: folders are not claimed there
    fcntl = None  # type: ignore[assignment]


class FolderClaim:
    """Sole use of a folder while this object lives: a lock on the folder itself.

    The system lets go of it when the process ends, however it ends, and leaves no file behind.

    Parameters
    ----------
    path : Path
        An existing folder.

    Raises
    ------
    BadInput
        When another process is at work there.
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
        """Whether the claimed folder is still found under its path."""
        if self._descriptor is None:
            return path.is_dir()
        try:
            return os.path.samestat(os.fstat(self._descriptor), path.stat())
        except OSError:
            return False
