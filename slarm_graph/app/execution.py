# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Carry a job out in its run folder: record, log, final status; and take up an unfinished one."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from slarm_graph.access_points import AccessPoint
from slarm_graph.app.explore import explore_world
from slarm_graph.app.job import Job, Run
from slarm_graph.app.pipeline import run
from slarm_graph.app.progress import Progress
from slarm_graph.app.run_folder import RunFolder, read_record
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.configs import config_differences, load_config
from slarm_graph.files.inputs import input_facts
from slarm_graph.files.worlds import world_to_yaml
from slarm_graph.world import WorldMap

_log = logging.getLogger(__name__)
_LOG_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


def execute(job: Job, folder: RunFolder, progress: Progress) -> Run:
    """Run a job to its end and record how it went.

    The status becomes `ok`, `partial` when some of the results are there, or `failed`.

    Raises
    ------
    BadInput, RunFailed
        When there is nothing to show for it.
    """
    with _recorded(folder, job.config):
        folder.note(input=input_facts(job.paths), job=_job_facts(job))
        return _ended(folder, run(job, folder, progress))


def execute_exploration(
    world: WorldMap, config: RunConfig, folder: RunFolder, progress: Progress
) -> Run:
    """Explore a world to the end and record how it went, as `execute` does."""
    with _recorded(folder, config):
        folder.write_text("world.yaml", world_to_yaml(world))
        folder.note(input={"world": world.name})
        return _ended(folder, explore_world(world, config, folder, progress))


def _ended(folder: RunFolder, done: Run) -> Run:
    for notice in done.notices():
        _log.info(notice)
    problem = done.log.problem
    folder.note(status="partial" if problem else "ok", problem=problem)
    return done


def resumed_job(path: Path, config_file: Path | None, overrides: Iterable[str]) -> Job:
    """Rebuild the job of an unfinished run from its folder.

    Parameters
    ----------
    path : Path
        The run folder.
    config_file, overrides
        As for `load_config`; only `checkpoint` keys may differ from what the run began with.

    Raises
    ------
    BadInput
        When the recording or the configuration has changed since, listing what.
    """
    record = read_record(path)
    facts, recorded_input = record.get("job"), record.get("input")
    if not isinstance(facts, dict) or not isinstance(recorded_input, dict):
        raise BadInput(f"{path}: stopped before anything was read; start it anew")
    config = load_config(path / "config.yaml")
    wanted = load_config(config_file or path / "config.yaml", overrides)
    changed = [d for d in config_differences(config, wanted) if not d.startswith("checkpoint.")]
    if changed:
        raise BadInput(f"{path}: cannot resume with another configuration ({'; '.join(changed)})")
    paths = tuple(Path(p) for p in recorded_input["paths"])
    if input_facts(paths) != recorded_input:
        raise BadInput(f"{path}: cannot resume, the recording has changed: {paths[0]}")
    return Job(
        paths,
        wanted,
        tuple(AccessPoint(**ap) for ap in facts["access_points"]),
        _path_or_none(facts["ground_truth"]),
        _path_or_none(facts["relations"]),
    )


def _job_facts(job: Job) -> dict[str, object]:
    return {
        "access_points": [asdict(ap) for ap in job.access_points],
        "ground_truth": str(job.ground_truth.resolve()) if job.ground_truth else None,
        "relations": str(job.relations.resolve()) if job.relations else None,
    }


def _path_or_none(text: str | None) -> Path | None:
    return Path(text) if text else None


@contextmanager
def _recorded(folder: RunFolder, config: RunConfig) -> Iterator[None]:
    """Record the configuration; on failure why, and whether there are results all the same."""
    folder.write_text("config.yaml", config_yaml(config))
    folder.note(seed=config.seed, backend=config.backend)
    with _logged(folder), early_end_noted(folder):
        yield


@contextmanager
def early_end_noted(folder: RunFolder) -> Iterator[None]:
    """Record why what is done inside ended early, `partial` when there are results all the same."""
    try:
        yield
    except KeyboardInterrupt:
        folder.note(status="partial", problem="interrupted")
        raise
    except Exception as error:
        there = (folder.path / "trajectory.tum").is_file()
        _log.error("%s", error, exc_info=error)
        folder.note(status="partial" if there else "failed", problem=str(error))
        raise


@contextmanager
def _logged(folder: RunFolder) -> Iterator[None]:
    """Write what the package logs to `log.txt`."""
    handler = logging.FileHandler(folder.path / "log.txt", encoding="utf-8")
    handler.setFormatter(logging.Formatter(_LOG_FORMAT))
    logger = logging.getLogger("slarm_graph")
    level = logger.level
    logger.setLevel(logging.INFO)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()
