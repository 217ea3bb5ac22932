# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Enough of a run to go on with it later: one file, complete or absent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.random import Generator

from slarm_graph.app.run_folder import CHECKPOINT, RunFolder
from slarm_graph.backend import SlamBackend
from slarm_graph.errors import BadInput
from slarm_graph.reading_log import ReadingLog

_STATE = f"{CHECKPOINT}/state.npz"


def save_checkpoint(
    folder: RunFolder, rng: Generator, backend: SlamBackend, log: ReadingLog
) -> None:
    """Write the state of backend and random numbers, and which readings they come from."""
    with folder.replacing(_STATE) as temporary:
        np.savez(
            temporary,
            stamps_ns=log.stamps_ns,
            random_state=np.array(json.dumps(rng.bit_generator.state)),
            backend=np.frombuffer(backend.snapshot(), dtype=np.uint8),
        )
    folder.note(scans=len(log))


def load_checkpoint(path: Path, backend: SlamBackend, rng: Generator) -> int | None:
    """Bring backend and random numbers to where the checkpoint was written.

    Returns the stamp of the latest reading that the backend had had by then [ns].

    Parameters
    ----------
    path : Path
        The run folder. Without a checkpoint in it the run starts from the beginning.
    backend : SlamBackend
        Of the same configuration.
    rng : numpy.random.Generator
        The one that was handed to the backend.

    Raises
    ------
    BadInput
        When the checkpoint cannot be read.
    """
    state = path / _STATE
    if not state.is_file():
        return None
    try:
        with np.load(state) as saved:
            backend.restore(saved["backend"].tobytes())
            rng.bit_generator.state = json.loads(str(saved["random_state"]))
            return int(saved["stamps_ns"][-1]) if len(saved["stamps_ns"]) else None
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise BadInput(f"{state}: the checkpoint cannot be read ({error})") from None
