# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a comparison: every source with every backend and seed."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from slarm_graph.files.worlds import shipped_worlds
from slarm_graph.frontends.recordings.sources import existing_paths


@dataclass(frozen=True, slots=True)
class TrialSource:
    """A recording, or a world to be explored.

    Parameters
    ----------
    place : str
        Path; of a world also the name of one that comes along.
    is_world : bool
    """

    place: str
    is_world: bool


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of a comparison.

    Parameters
    ----------
    source : Source
    backend : str
    seed : int
    folder : Path
        Its run folder, below the comparison's.
    options : tuple of str
        Further words of the command line.
    """

    source: TrialSource
    backend: str
    seed: int
    folder: Path
    options: tuple[str, ...] = ()

    def command(self) -> list[str]:
        """Return the command line of the run."""
        place = self.source.place
        what = ("explore", "--world", place) if self.source.is_world else ("run", place)
        return [
            *(sys.executable, "-m", "slarm_graph", *what),
            *("--backend", self.backend, "--seed", str(self.seed)),
            *("--out", str(self.folder.parent), "--name", self.folder.name),
            *self.options,
        ]


def find_sources(given: Sequence[str]) -> tuple[TrialSource, ...]:
    """Tell recordings and worlds apart.

    Raises
    ------
    BadInput
        When one is missing.
    """
    return tuple(_find(source) for source in given)


def _find(given: str) -> TrialSource:
    shipped, path = given in shipped_worlds(), Path(given)
    if shipped or (path.suffix in (".yaml", ".yml") and path.name != "metadata.yaml"):
        return TrialSource(given if shipped else str(path.resolve()), True)
    return TrialSource(str(existing_paths(given)[0].resolve()), False)


def trials(
    sources: Sequence[TrialSource],
    backends: Sequence[str],
    seeds: int,
    folder: Path,
    *,
    options: Sequence[str] = (),
    for_recordings: Sequence[str] = (),
) -> tuple[Trial, ...]:
    """Plan every source with every backend and the seeds 0 ... `seeds` - 1.

    A file beside a recording that has its name and ends in `.relations` or `.tum` is taken for
    what is known to be true of it.

    Parameters
    ----------
    sources : sequence of Source
    backends : sequence of str
    seeds : int
    folder : Path
        The comparison's.
    options, for_recordings : sequence of str
        Further words of the command line, for every run and for recordings only.
    """
    names = _unique_names([Path(source.place) for source in sources])
    planned = []
    for source, name in zip(sources, names, strict=True):
        references = () if source.is_world else (*for_recordings, *_references(Path(source.place)))
        for backend, seed in product(backends, range(seeds)):
            place = folder.resolve() / f"{name}_{backend}_{seed}"
            planned.append(Trial(source, backend, seed, place, (*options, *references)))
    return tuple(planned)


def _unique_names(paths: Sequence[Path]) -> list[str]:
    stems = [path.name.split(".")[0] for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{number}_{path.name.replace('.', '_')}"
        for number, (stem, path) in enumerate(zip(stems, paths, strict=True), start=1)
    ]


def _references(source: Path) -> Iterator[str]:
    for option, suffix in (("--relations", ".relations"), ("--ground-truth", ".tum")):
        beside = source.with_name(source.name.split(".")[0] + suffix)
        if beside.is_file():
            yield from (option, str(beside.resolve()))
