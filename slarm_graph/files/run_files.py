# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Files by themselves or in the folder of a run, whichever a user names."""

from __future__ import annotations

from pathlib import Path

from slarm_graph.errors import BadInput


def of_run(place: Path, *names: str) -> Path:
    """Return the first of some files that a run folder has, or the file that was named itself.

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
