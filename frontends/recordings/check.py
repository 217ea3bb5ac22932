# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnose a recording before it is used: most bad maps come from bad recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.findings import (
    WARNING,
    Diagnosis,
    Finding,
    Look,
    Severity,
    TopicFacts,
)
from slarm_graph.frontends.recordings.formats import Sections, format_of
from slarm_graph.frontends.recordings.sources import existing_paths, open_source

_ORDER = {"error": 0, "warning": 1, "note": 2}
"""Order of the findings: the worst first."""


def check(
    paths: Sequence[Path | str] | Path | str,
    config: SourceConfig | None = None,
    section: Sections | None = None,
) -> Diagnosis:
    """Diagnose a recording; never raises, whatever the file.

    Parameters
    ----------
    paths : path or sequence of paths
    config : SourceConfig, optional
        As for the run.
    section : callable, optional
        As for `open_source`.

    Returns
    -------
    Diagnosis
    """
    config = config or SourceConfig()
    name = ", ".join(str(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths))
    description = name
    topics: tuple[TopicFacts, ...] = ()
    findings: list[Finding] = []
    readings = 0
    try:
        files = existing_paths(paths)
        look = format_of(files, section).check(files, config)
        findings = list(look)
        if isinstance(look, Look):
            description, topics = look.description or name, look.topics
        source = open_source(files, config, section=section)
        readings = len(list(source))
        findings += _as_used(source.info().notices, findings)
    except BadInput as error:
        findings.append(Finding("error", "recording", str(error)))
    except Exception as error:  # a diagnosis has to end in words on any file
        told = f"{type(error).__name__}: {error}"
        findings.append(
            Finding("error", "recording", told, "the file is damaged in a way not foreseen")
        )
    ordered = sorted(findings, key=lambda finding: _ORDER[finding.severity])
    return Diagnosis(description, topics, tuple(ordered), readings)


def _as_used(notices: Sequence[str], findings: Sequence[Finding]) -> list[Finding]:
    """Return the notices of a run that are not among the findings yet, with their severity."""
    known = {finding.what for finding in findings}
    used = []
    for notice in notices:
        text = notice.removeprefix(WARNING)
        severity: Severity = "note" if text == notice else "warning"
        if not any(what in text for what in known):
            used.append(Finding(severity, "as used", text))
    return used
