# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Execution of a job in its run folder: record, log, final status."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace

from slarm_graph.app.checkpoint import remove_checkpoint
from slarm_graph.app.ending import exit_handler
from slarm_graph.app.explore import explore_world, with_prior
from slarm_graph.app.job import ExploreJob, Job, Run
from slarm_graph.app.pipeline import run
from slarm_graph.app.progress import Progress
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.config import RunConfig
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.inputs import input_facts
from slarm_graph.files.worlds import world_to_yaml

_log = logging.getLogger(__name__)
_LOG_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


def execute(job: Job | ExploreJob, folder: RunFolder, progress: Progress) -> Run:
    """Run a job and record how it ended.

    The status becomes `ok`, `partial` when some of the results are there, or `failed`.

    Raises
    ------
    BadInput, RunFailed
        When there are no results.
    """
    if isinstance(job, ExploreJob):
        job = replace(job, config=with_prior(job.world, job.config))
    with _record(folder, job.config):
        if isinstance(job, ExploreJob):
            folder.write_text("world.yaml", world_to_yaml(job.world))
            folder.note(input={"world": job.world.name})
            done = explore_world(job.world, job.config, folder, progress)
        else:
            folder.note(input=input_facts(job.paths), job=_job_facts(job))
            done = run(job, folder, progress)
        return _record_success(folder, done)


def _record_success(folder: RunFolder, done: Run) -> Run:
    for notice in done.notices():
        _log.info(notice)
    problem = done.log.problem
    folder.note(status="partial" if problem else "ok", problem=problem)
    if not problem and not done.config.checkpoint.keep:
        remove_checkpoint(folder.path)
    return done


def _job_facts(job: Job) -> dict[str, object]:
    return {
        "access_points": [asdict(ap) for ap in job.access_points],
        "ground_truth": str(job.ground_truth.resolve()) if job.ground_truth else None,
        "relations": str(job.relations.resolve()) if job.relations else None,
        "rss": list(job.rss),
    }


@contextmanager
def _record(folder: RunFolder, config: RunConfig) -> Iterator[None]:
    """Record the configuration, and how the block ended early, if it does; write the log."""
    folder.write_text("config.yaml", config_yaml(config))
    folder.note(seed=config.seed, backend=config.backend)
    with (
        _write_log(folder),
        exit_handler(lambda why: _record_end(folder, why), config.limits),
        record_early_end(folder),
    ):
        yield


def _record_end(folder: RunFolder, why: str) -> None:
    """Record that the process is ended, and print how to resume."""
    folder.end_early(why, by_user=True)
    for line in folder.resume_hints(why):
        print(f"slarm: {line}", file=sys.stderr)


@contextmanager
def record_early_end(folder: RunFolder) -> Iterator[None]:
    """Record why the block ended early: `partial` when there are results, else `failed`."""
    try:
        yield
    except KeyboardInterrupt:
        folder.end_early("interrupted", by_user=True)
        for line in folder.resume_hints("interrupted"):
            _log.warning(line)
        raise
    except Exception as error:
        _log.error("%s", error, exc_info=error)
        folder.end_early(str(error), by_user=False)
        raise


@contextmanager
def _write_log(folder: RunFolder) -> Iterator[None]:
    """Write the package's log to `log.txt` while the block runs."""
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
