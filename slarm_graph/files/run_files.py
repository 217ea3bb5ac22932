# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Paths that a user gives as a file or as the run folder that contains it."""

from __future__ import annotations

from pathlib import Path

from slarm_graph.errors import BadInput


def of_run(place: Path, *names: str) -> Path:
    """Return the first existing of some files of a run folder, or the path if it is a file.

    Raises
    ------
    BadInput
        When the folder has none of them.
    """
    if not place.is_dir():
        return place
    found = next((place / name for name in names if (place / name).is_file()), None)
    if found is None:
        raise BadInput(f"{place}: no {' or '.join(names)} in it; is it a run folder?")
    return found


def map_file(place: Path) -> Path:
    """Return the map in a run folder, or the file itself.

    Raises
    ------
    BadInput
        When the folder has none.
    """
    return of_run(place, "map.yaml")
