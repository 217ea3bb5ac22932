# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Enough of a run to go on with it later: one file, complete or absent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.random import Generator

from slarm_graph.app.intake import Intake
from slarm_graph.app.run_folder import CHECKPOINT, RunFolder
from slarm_graph.backend import SlamBackend
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Pose2

_STATE = f"{CHECKPOINT}/state.npz"


def save_checkpoint(
    folder: RunFolder, rng: Generator, backend: SlamBackend, intake: Intake
) -> None:
    """Write the state of the backend, of the random numbers and of what was read."""
    with folder.replacing(_STATE) as temporary:
        np.savez(
            temporary,
            stamps_ns=np.array(intake.stamps_ns, dtype=np.int64),
            odometry=np.array(intake.odometry, dtype=np.float64).reshape(-1, 3),
            robot_from_laser=intake.robot_from_laser.as_array(),
            random_state=np.array(json.dumps(rng.bit_generator.state)),
            backend=np.frombuffer(backend.snapshot(), dtype=np.uint8),
        )
    folder.note(scans=len(intake.stamps_ns))


def load_checkpoint(path: Path, backend: SlamBackend, rng: Generator) -> Intake:
    """Bring backend and random numbers to where the checkpoint was written.

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
        return Intake()
    try:
        with np.load(state) as saved:
            backend.restore(saved["backend"].tobytes())
            rng.bit_generator.state = json.loads(str(saved["random_state"]))
            return Intake(
                saved["stamps_ns"].tolist(),
                [(x, y, theta) for x, y, theta in saved["odometry"].tolist()],
                Pose2.from_array(saved["robot_from_laser"]),
            )
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise BadInput(f"{state}: the checkpoint cannot be read ({error})") from None
