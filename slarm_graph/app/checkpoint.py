# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The checkpoint of a run, from which it is resumed: one file, written atomically."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from slarm_graph.app.run_folder import CHECKPOINT, RunFolder
from slarm_graph.config import CheckpointConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.states import SavedStates, read_states, write_states
from slarm_graph.snapshots import BadState

_log = logging.getLogger(__name__)

_STATE: Final = f"{CHECKPOINT}/state.npz"


class Checkpoint:
    """Writes the checkpoint of a run at intervals.

    Parameters
    ----------
    folder : RunFolder
    rule : CheckpointConfig
    take : callable
        Returns the states to write.
    """

    def __init__(
        self, folder: RunFolder, rule: CheckpointConfig, take: Callable[[], SavedStates]
    ) -> None:
        self._folder, self._rule, self._take = folder, rule, take
        self._written_s = time.monotonic()

    def write_if_due(self) -> None:
        """Write the checkpoint when it is due."""
        if time.monotonic() - self._written_s >= self._rule.every_s:
            self.write()

    def write_last(self, *, ended_early: bool) -> None:
        """Write the final checkpoint where it will be resumed from or kept; else only when due."""
        if ended_early or self._rule.keep:
            self.write()
        else:
            self.write_if_due()

    def write(self) -> None:
        """Write the checkpoint now; a failure is logged, and the run goes on."""
        try:
            with self._folder.replacing(_STATE) as temporary:
                write_states(temporary, self._take())
        except (OSError, TypeError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            _log.warning("the checkpoint could not be written (%s); the run goes on", reason)
        self._written_s = time.monotonic()


@contextmanager
def saved_states(path: Path) -> Iterator[SavedStates | None]:
    """Yield the states in a run folder's checkpoint, to be restored in the block; None without.

    Raises
    ------
    BadInput
        When the checkpoint cannot be used.
    """
    state = path / _STATE
    try:
        yield read_states(state) if state.is_file() else None
    except (BadState, LookupError) as error:
        raise BadInput(
            f"{state}: the checkpoint does not fit this program ({str(error)[:120]});"
            " start the run anew, without --resume"
        ) from None


def remove_checkpoint(path: Path) -> None:
    """Remove the checkpoint of a finished run."""
    shutil.rmtree(path / CHECKPOINT, ignore_errors=True)
