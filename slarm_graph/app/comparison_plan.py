# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a comparison: every source with every backend, setting and seed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import slarm_graph
from slarm_graph import parts
from slarm_graph.app.provenance import git_revision
from slarm_graph.app.reference_files import find_references, one_per_source
from slarm_graph.app.trials import Trial, TrialSource
from slarm_graph.errors import BadInput
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.configs import load_config
from slarm_graph.files.inputs import input_facts
from slarm_graph.files.worlds import shipped_worlds
from slarm_graph.frontends.recordings.sources import existing_paths


def find_sources(
    given: Sequence[str],
    ground_truths: Sequence[Path] | None = None,
    relations: Sequence[Path] | None = None,
) -> tuple[TrialSource, ...]:
    """Tell recordings from worlds, and find the reference files of recordings.

    Raises
    ------
    BadInput
        When one is missing.
    """
    truths = one_per_source("--ground-truth", ground_truths, len(given))
    related = one_per_source("--relations", relations, len(given))
    return tuple(_find(*found) for found in zip(given, truths, related, strict=True))


def _find(given: str, ground_truth: Path | None, relations: Path | None) -> TrialSource:
    shipped, path = given in shipped_worlds(), Path(given)
    if shipped or (path.suffix in (".yaml", ".yml") and path.name != "metadata.yaml"):
        return TrialSource(given if shipped else str(path.resolve()), True)
    place = existing_paths(given)[0].resolve()
    return TrialSource(str(place), False, find_references(place, ground_truth, relations))


def settings_of(sweeps: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return every combination of swept values, each as `KEY=VALUE` words.

    Parameters
    ----------
    sweeps : sequence of str
        `KEY=V1,V2,...`

    Raises
    ------
    BadInput
        When one has another form.
    """
    axes = []
    for sweep in sweeps:
        key, _, values = sweep.partition("=")
        found = [f"{key.strip()}={value.strip()}" for value in values.split(",") if value.strip()]
        if not key.strip() or not found:
            raise BadInput(f"--sweep {sweep}: expected KEY=V1,V2,...")
        axes.append(found)
    return tuple(product(*axes))


@dataclass(frozen=True, slots=True)
class ComparisonPlan:
    """What to compare.

    Parameters
    ----------
    sources : tuple of TrialSource
    backends : tuple of str
    seeds : int
        0, 1, ... `seeds` - 1.
    config : Path or None
    settings : tuple of str
        `KEY=VALUE`, for every run.
    sweeps : tuple of str
        `KEY=V1,V2`; a key of one backend's section is swept for that backend only.
    for_recordings : tuple of str
        Further command-line arguments for recordings.
    """

    sources: tuple[TrialSource, ...]
    backends: tuple[str, ...]
    seeds: int
    config: Path | None = None
    settings: tuple[str, ...] = ()
    sweeps: tuple[str, ...] = ()
    for_recordings: tuple[str, ...] = ()

    def trials(self, folder: Path) -> tuple[Trial, ...]:
        """Return a trial for every source, backend, setting and seed, with folders in `folder`.

        Raises
        ------
        BadInput
            When a setting is not one.
        """
        planned: dict[tuple[object, ...], Trial] = {}
        names = _unique_names([Path(source.place) for source in self.sources])
        hashes = [_hash_of(source) for source in self.sources]
        every = product(
            zip(self.sources, names, hashes, strict=True), self.backends, range(self.seeds)
        )
        for (source, name, content), backend, seed in every:
            for setting in settings_of(self.sweeps):
                mine = tuple(word for word in setting if _concerns(word, backend))
                trial = self._trial(source, content, backend, seed, mine, folder.resolve() / name)
                planned.setdefault((name, backend, seed, mine), trial)
        return tuple(planned.values())

    def _trial(
        self,
        source: TrialSource,
        content: str,
        backend: str,
        seed: int,
        setting: tuple[str, ...],
        start: Path,
    ) -> Trial:
        words = (*self.settings, *setting)
        config = load_config(self.config, [*words, f"backend={backend}", f"seed={seed}"])
        extra = () if source.is_world else (*self.for_recordings, *source.truth.words())
        facts = [
            slarm_graph.__version__,
            git_revision() or "",
            content,
            config_yaml(config),
            *self.for_recordings,
        ]
        key = hashlib.sha256("\n".join(facts).encode()).hexdigest()
        options = [*(("--config", str(self.config.resolve())) if self.config else ())]
        options += [word for setting in words for word in ("--set", setting)]
        # Settings do not fit into names of files: their hash does.
        mark = f"_{hashlib.sha256(' '.join(setting).encode()).hexdigest()[:6]}" if setting else ""
        place = start.with_name(f"{start.name}_{backend}_{seed}{mark}")
        return Trial(source, backend, seed, place, (*options, *extra), " ".join(setting), key)


def _hash_of(source: TrialSource) -> str:
    """Return a hash of the content of a source and of its reference files."""
    truth = [path for path in (source.truth.ground_truth, source.truth.relations) if path]
    known = str(input_facts(truth)["sha256"])
    place = Path(source.place)
    if source.is_world and source.place in shipped_worlds():
        return f"{source.place} {known}"
    paths = existing_paths(source.place) if not source.is_world else [place]
    return f"{input_facts(paths)['sha256']} {known}"


def _concerns(setting: str, backend: str) -> bool:
    """Whether a setting applies to a backend: not in another backend's section."""
    section = setting.partition(".")[0]
    return section == backend or section not in parts.registered("backend")


def _unique_names(paths: Sequence[Path]) -> list[str]:
    stems = [path.name.split(".")[0] for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{number}_{path.name.replace('.', '_')}"
        for number, (stem, path) in enumerate(zip(stems, paths, strict=True), start=1)
    ]
