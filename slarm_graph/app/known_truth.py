# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known to be true of a recording: one rule for `run` and `compare`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slarm_graph.errors import BadInput

NONE = Path("none")
"""In place of a file: take none, not even one that lies beside the recording."""


@dataclass(frozen=True, slots=True)
class KnownTruth:
    """Files with what is known to be true of a recording.

    Parameters
    ----------
    ground_truth, relations : Path or None
    found : tuple of str
        Which of them were not given but found beside the recording, in words.
    """

    ground_truth: Path | None = None
    relations: Path | None = None
    found: tuple[str, ...] = ()

    def words(self) -> tuple[str, ...]:
        """Return the files as words of a command line; those left out on purpose, too."""
        pairs = (("--ground-truth", self.ground_truth), ("--relations", self.relations))
        return tuple(word for option, path in pairs for word in (option, str(path or NONE)))


def known_truth(
    source: Path, ground_truth: Path | None = None, relations: Path | None = None
) -> KnownTruth:
    """Take what is given; else a file beside the recording with its name and `.tum`/`.relations`.

    Parameters
    ----------
    source : Path
        The recording, the first of several.
    ground_truth, relations : Path, optional
        As given; `none` for none at all.

    Raises
    ------
    BadInput
        When a given file is not there.
    """
    found: list[str] = []
    chosen = [
        _chosen(source, given, suffix, found)
        for given, suffix in ((ground_truth, ".tum"), (relations, ".relations"))
    ]
    return KnownTruth(chosen[0], chosen[1], tuple(found))


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
    """Give every source its file: one for all, or one each in the sources' order.

    Raises
    ------
    BadInput
        When there is another number of them.
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
