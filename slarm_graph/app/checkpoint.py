# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The checkpoint of a run, from which it is resumed: one file, written atomically."""

from __future__ import annotations

import logging
import math
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
_FAILURE_EVERY_S = 3600.0
"""Mean time between failures [s], supposed: a lid that is closed, a job that is stopped. The
interval goes with its root: half of it, and checkpoints take 1.4 times as much of a run."""
_FIRST_COST_S = 0.5
"""Duration of a checkpoint before one was written [s]: the first is due after a minute."""


class WriteInterval:
    """Interval between writes that protect a run against failures.

    Not given, it is what loses least, in writing and in work that a failure undoes: sqrt(2 C M)
    for writes of C seconds and a failure every M (Young, "A first order approximation to the
    optimum checkpoint interval", Communications of the ACM 17(9), 1974).

    Parameters
    ----------
    every_s : float or None
        The interval [s], where it is given.
    """

    def __init__(self, every_s: float | None) -> None:
        self._every_s = every_s
        self._cost_s = _FIRST_COST_S
        self._written_s = time.monotonic()

    def is_due(self) -> bool:
        """Whether the interval since the last write has passed."""
        every_s = self._every_s or math.sqrt(2.0 * self._cost_s * _FAILURE_EVERY_S)
        return time.monotonic() - self._written_s >= every_s

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Time the write in the block, unless it fails; the next interval begins where it ends."""
        begun_s = time.monotonic()
        try:
            yield
            self._cost_s = time.monotonic() - begun_s
        finally:
            self._written_s = time.monotonic()


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
        self._folder, self._keep, self._take = folder, rule.keep, take
        self._interval = WriteInterval(rule.every_s)

    def write_if_due(self) -> None:
        """Write the checkpoint when it is due."""
        if self._interval.is_due():
            self.write()

    def write_last(self, *, ended_early: bool) -> None:
        """Write the final checkpoint where it will be resumed from or kept; else only when due."""
        if ended_early or self._keep:
            self.write()
        else:
            self.write_if_due()

    def write(self) -> None:
        """Write the checkpoint now; a failure is logged, and the run goes on."""
        try:
            with self._interval.writing(), self._folder.replacing(_STATE) as temporary:
                write_states(temporary, self._take())
        except (OSError, TypeError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            _log.warning("the checkpoint could not be written (%s); the run goes on", reason)


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
