# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Files with the ground truth of a recording: one rule for `run` and `compare`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slarm_graph.errors import BadInput

NONE = Path("none")
"""Given instead of a file: use none, not even one beside the recording."""


@dataclass(frozen=True, slots=True)
class ReferenceFiles:
    """Files with the ground-truth trajectory and relative poses of a recording.

    Parameters
    ----------
    ground_truth, relations : Path or None
    found : tuple of str
        A notice for each of them that was not given but found beside the recording.
    """

    ground_truth: Path | None = None
    relations: Path | None = None
    found: tuple[str, ...] = ()

    def words(self) -> tuple[str, ...]:
        """Return the files as command-line arguments; `none` for those that there are not."""
        pairs = (("--ground-truth", self.ground_truth), ("--relations", self.relations))
        return tuple(word for option, path in pairs for word in (option, str(path or NONE)))


def find_references(
    source: Path, ground_truth: Path | None = None, relations: Path | None = None
) -> ReferenceFiles:
    """Use the given files, else those beside the recording: its name with `.tum`/`.relations`.

    Parameters
    ----------
    source : Path
        The recording, the first of several.
    ground_truth, relations : Path, optional
        As given; `none`: without.

    Raises
    ------
    BadInput
        When a given file does not exist.
    """
    found: list[str] = []
    chosen = [
        _chosen(source, given, suffix, found)
        for given, suffix in ((ground_truth, ".tum"), (relations, ".relations"))
    ]
    return ReferenceFiles(chosen[0], chosen[1], tuple(found))


def _chosen(source: Path, given: Path | None, suffix: str, found: list[str]) -> Path | None:
    if given is None:
        beside = source.with_name(source.name.split(".")[0] + suffix)
        if not beside.is_file():
            return None
        found.append(f"taken for true, beside the recording: {beside}")
        return beside.resolve()
    if given == NONE:
        return None
    if not given.is_file():
        raise BadInput(f"no such file: {given}")
    return given.resolve()


def one_per_source(
    option: str, given: Sequence[Path] | None, count: int
) -> tuple[Path | None, ...]:
    """Return a file per source: the same for all, or one each in the sources' order.

    Raises
    ------
    BadInput
        When the number of files fits neither.
    """
    if not given:
        return (None,) * count
    if len(given) == 1:
        return (given[0],) * count
    if len(given) != count:
        raise BadInput(
            f"{option} is given {len(given)} times for {count} sources: once or for each"
        )
    return tuple(given)
