# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""States of objects as one file: numpy's `.npz` of bytes and JSON, never a pickle."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph import __version__
from slarm_graph.errors import BadInput
from slarm_graph.files.arrays import FAILURES, load_arrays
from slarm_graph.snapshots import State

FORMAT: Final = 10
"""Version of the format; others are refused."""
_ANEW: Final = "start the run anew, without --resume"


@dataclass(frozen=True, slots=True)
class SavedStates:
    """The content of a file of states.

    Parameters
    ----------
    states : mapping of str to State
    facts : mapping of str to int or str
        Further facts, such as the number of readings.
    """

    states: Mapping[str, State]
    facts: Mapping[str, int | str]


def write_states(path: Path, saved: SavedStates) -> None:
    """Write states, uncompressed: they are written often and read seldom."""
    header = {
        "format": FORMAT,
        "program": __version__,
        "facts": dict(saved.facts),
        "states": list(saved.states),
    }
    arrays = {"header": _bytes(json.dumps(header))}
    for name, state in saved.states.items():
        arrays |= {f"{name}.tree": _bytes(state.tree), f"{name}.data": state.data}
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read_states(path: Path) -> SavedStates:
    """Read states.

    Raises
    ------
    BadInput
        When the file is damaged, or another version of the program wrote it.
    """
    try:
        return _read(path)
    except BadInput:
        raise
    except (*FAILURES, LookupError) as error:
        raise BadInput(f"{path}: the checkpoint is damaged ({_reason(error)}); {_ANEW}") from None


def _read(path: Path) -> SavedStates:
    with zipfile.ZipFile(path) as archive:
        # What is not compressed cannot be larger than the file.
        if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
            raise ValueError("it is compressed")
    arrays = load_arrays(path, path.stat().st_size)
    header = json.loads(arrays["header"].tobytes())
    written = header["format"], header["program"]
    if written != (FORMAT, __version__):
        raise BadInput(
            f"{path}: the checkpoint is of slarm-graph {str(written[1])[:20]}, format"
            f" {str(written[0])[:20]}; this is {__version__}, format {FORMAT}; {_ANEW}"
        )
    states = {
        str(name): State(arrays[f"{name}.tree"].tobytes().decode(), _data(arrays, name))
        for name in header["states"]
    }
    return SavedStates(states, dict(header["facts"]))


def _data(arrays: Mapping[str, NDArray[Any]], name: str) -> np.ndarray:
    data = arrays[f"{name}.data"]
    if data.dtype != np.uint8 or data.ndim != 1:
        raise ValueError(f"{name} is not bytes")
    return np.asarray(data)


def _bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), dtype=np.uint8)


def _reason(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__)[:120]
