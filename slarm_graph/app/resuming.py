# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Resuming of an unfinished run: its job is rebuilt from its folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from slarm_graph.access_points import AccessPoint
from slarm_graph.app.job import ExploreJob, Job
from slarm_graph.app.run_folder import read_record
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.configs import config_differences, load_config
from slarm_graph.files.inputs import input_facts
from slarm_graph.files.worlds import load_world

_MAY_DIFFER = ("checkpoint.", "limits.")
"""Settings on which the result does not depend."""


def resumed_job(path: Path, config_file: Path | None, overrides: Iterable[str]) -> Job | ExploreJob:
    """Rebuild the job of an unfinished run from its folder.

    Parameters
    ----------
    path : Path
        The run folder.
    config_file, overrides
        As for `load_config`; only keys of `checkpoint` and `limits` may differ from those of
        the run.

    Raises
    ------
    BadInput
        When the recording or the configuration has changed since; lists the changes.
    """
    record = read_record(path)
    recorded_input = record.get("input")
    if not isinstance(recorded_input, dict):
        raise BadInput(f"{path}: stopped before anything was read; start it anew")
    config = _same_config(path, config_file, overrides)
    if "world" in recorded_input:
        return ExploreJob(load_world(path / "world.yaml"), config)
    try:
        return _recording_job(record, recorded_input, config)
    except BadInput:
        raise
    except (LookupError, TypeError, ValueError, AttributeError):
        raise BadInput(f"{path}: its run.json is damaged; start the run anew") from None


def _same_config(path: Path, config_file: Path | None, overrides: Iterable[str]) -> RunConfig:
    config = load_config(path / "config.yaml")
    wanted = load_config(config_file or path / "config.yaml", overrides)
    changed = [d for d in config_differences(config, wanted) if not d.startswith(_MAY_DIFFER)]
    if changed:
        raise BadInput(f"{path}: cannot resume with another configuration ({'; '.join(changed)})")
    return wanted


def _recording_job(
    record: Mapping[str, Any], recorded_input: Mapping[str, Any], config: RunConfig
) -> Job:
    paths, facts = tuple(Path(p) for p in recorded_input["paths"]), record["job"]
    if input_facts(paths) != recorded_input:
        raise BadInput(f"cannot resume, the recording has changed: {paths[0]}")
    return Job(
        paths,
        config,
        tuple(AccessPoint(**ap) for ap in facts["access_points"]),
        _path_or_none(facts["ground_truth"]),
        _path_or_none(facts["relations"]),
        tuple(facts.get("rss", ())),
    )


def _path_or_none(text: str | None) -> Path | None:
    return Path(text) if text else None
