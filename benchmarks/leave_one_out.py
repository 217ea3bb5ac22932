# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What settings chosen without a recording are worth on it.

    python benchmarks/leave_one_out.py intel.clf.gz fr079.clf.gz mit-csail.clf.gz [--jobs 2]

Every number among the settings of `frontend` and `pose_graph` is halved and doubled, one at a time,
on every recording. For each recording the factors are chosen that serve the others best (mean of
the logarithms of their errors), all are set together, and the recording left out judges. Beside
every recording its `.relations` is expected; errors are means over the relations [m].
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from pydantic import BaseModel

from slarm_graph.app.calls import run_backend
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput, RunFailed
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.files.configs import load_config
from slarm_graph.frontends.recordings.sources import open_source

FACTORS = (0.5, 2.0)
"""Half and double, as every number of the project is judged."""
WORTH = 0.002
"""A gain of less than 0.2 % on the others is rounding or luck, and the default stays."""

Choice = Mapping[str, float]
"""Factors of settings, by their dotted names; those not named keep their default."""


def settings() -> dict[str, float]:
    """Return names and defaults of all numbers among the settings of the pose graph's flow."""
    config = RunConfig()
    sections = (("frontend", config.frontend), ("pose_graph", config.section("pose_graph")))
    return {name: value for where, model in sections for name, value in _numbers(where, model)}


def _numbers(where: str, model: BaseModel) -> Iterator[tuple[str, float]]:
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _numbers(f"{where}.{name}", value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{where}.{name}", value


def config_of(choice: Choice) -> RunConfig | None:
    """Return the configuration of a choice; None where a value is not allowed."""
    defaults, overrides = settings(), ["backend=pose_graph"]
    for name, factor in choice.items():
        value = defaults[name] * factor
        if isinstance(defaults[name], int):
            value = math.ceil(value)
        overrides.append(f"{name}={value}")
    try:
        return load_config(None, overrides)
    except BadInput:
        return None


def error_m(path: Path, choice: Choice) -> float:
    """Mean error over the relations of a recording [m]; inf where a run fails or is not allowed."""
    config = config_of(choice)
    if config is None:
        return math.inf
    readings = tuple(open_source([path]))
    try:
        estimate = run_backend(readings, config=config).trajectory
    except RunFailed:
        return math.inf
    relations = read_relations(path.with_name(path.name.split(".")[0] + ".relations"))
    laser = readings[0].scan.robot_from_laser
    return float(relation_errors(relations, estimate, laser).translation_m.mean())


def chosen(errors: Mapping[tuple[str, float], Sequence[float]], judges: Sequence[int]) -> Choice:
    """Return the factors that serve some recordings best, by the errors of all (name, factor).

    Parameters
    ----------
    errors : mapping
        Errors over the recordings, as multiples of those by default.
    judges : sequence of int
        The recordings that count.
    """
    best: dict[str, tuple[float, float]] = {}
    for (name, factor), ratios in errors.items():
        mean = sum(math.log(ratios[k]) for k in judges) / len(judges)
        if mean < min(best.get(name, (0.0, 1.0))[0], -WORTH):
            best[name] = mean, factor
    return {name: factor for name, (_, factor) in best.items()}


def main() -> None:
    """Print what every change does, what is chosen without each recording, and what it is worth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    places, names = given.recordings, [path.name.split(".")[0] for path in given.recordings]
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
        usual = list(pool.map(error_m, places, [{}] * len(places)))
        print("default", *(f"{name} {e:.4f}" for name, e in zip(names, usual, strict=True)))
        tried = {
            (name, factor): [pool.submit(error_m, place, {name: factor}) for place in places]
            for name in settings()
            for factor in FACTORS
            if config_of({name: factor}) is not None
        }
        errors = {}
        for key, runs in tried.items():
            errors[key] = [run.result() / e for run, e in zip(runs, usual, strict=True)]
            print(*key, *(f"{ratio:.3f}" for ratio in errors[key]), flush=True)
        print("| left out | by default | by what the others choose | chosen |")
        print("|---|---|---|---|")
        for k, name in enumerate(names):
            choice = chosen(errors, [other for other in range(len(names)) if other != k])
            told = ", ".join(f"{setting} x {factor:g}" for setting, factor in choice.items())
            found = pool.submit(error_m, places[k], choice).result()
            print(f"| {name} | {usual[k]:.4f} | {found:.4f} | {told} |", flush=True)


if __name__ == "__main__":
    main()
