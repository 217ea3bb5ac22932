# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The result of a diagnosis: findings with severity, count, first stamp and advice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.recordings import Topic

Severity = Literal["error", "warning", "note"]

WARNING = "warning: "
"""Prefix of a source's notices that are warnings."""
_SIGNS: dict[Severity, str] = {"error": "ERROR  ", "warning": "warning", "note": "note   "}


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem, certain or possible.

    Parameters
    ----------
    severity : "error" (cannot be used so), "warning" (results will suffer), "note"
    where : str
        Topic, frame or file.
    what : str
    advice : str
        What to do about it; may be empty.
    count : int
        How often; 0 when it cannot be counted.
    first_stamp_ns : int or None
        Stamp of the first occurrence [ns].
    """

    severity: Severity
    where: str
    what: str
    advice: str = ""
    count: int = 0
    first_stamp_ns: int | None = None


@dataclass(frozen=True, slots=True)
class TopicFacts:
    """Statistics of a topic.

    Parameters
    ----------
    name, msgtype, frame : str
    count : int
    rate_hz : float
    first_stamp_ns, last_stamp_ns : int or None
        Header stamps, where they were read.
    step_histogram : tuple of (upper edge [s], count)
        Time between successive messages in ten buckets.
    """

    name: str
    msgtype: str
    count: int
    rate_hz: float
    frame: str = ""
    first_stamp_ns: int | None = None
    last_stamp_ns: int | None = None
    step_histogram: tuple[tuple[float, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Look:
    """The result of a format's check of its files, besides problems in opening them.

    Parameters
    ----------
    findings : sequence of Finding
    description : str
        Of the recording; empty: its name.
    topics : tuple of TopicFacts
    """

    findings: Sequence[Finding]
    description: str = ""
    topics: tuple[TopicFacts, ...] = ()

    def __iter__(self) -> Iterator[Finding]:
        """Yield the findings."""
        return iter(self.findings)


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Everything that was found in a recording.

    Parameters
    ----------
    description : str
    topics : tuple of TopicFacts
    findings : tuple of Finding
        Worst first.
    readings : int
        How many readings a run would get; 0 when it would be refused.
    """

    description: str
    topics: tuple[TopicFacts, ...]
    findings: tuple[Finding, ...]
    readings: int = 0

    @property
    def exit_code(self) -> int:
        """0 nothing wrong, 1 warnings, 2 cannot be used as it is."""
        severities = {finding.severity for finding in self.findings}
        return 2 if "error" in severities else int("warning" in severities)

    def as_json(self) -> dict[str, object]:
        """Return plain lists and dictionaries."""
        return {**asdict(self), "exit_code": self.exit_code}

    def text(self) -> str:
        """Format as text, one paragraph per finding."""
        lines = [self.description, ""]
        width = max((len(topic.name) for topic in self.topics), default=0)
        for topic in self.topics:
            frame = f"  in {topic.frame}" if topic.frame else ""
            lines.append(
                f"  {topic.name:<{width}}  {topic.count:>7}  {topic.rate_hz:6.1f} Hz"
                f"  {topic.msgtype}{frame}"
            )
        if self.topics:
            lines.append("")
        for finding in self.findings:
            lines += _paragraph(finding)
        lines.append(_verdict(self))
        return "\n".join(lines)


def _paragraph(finding: Finding) -> list[str]:
    first = ""
    if finding.first_stamp_ns is not None:
        first = f" (first at {finding.first_stamp_ns * 1e-9:.3f} s)"
    lines = [f"{_SIGNS[finding.severity]} {finding.where}: {finding.what}{first}"]
    if finding.advice:
        lines.append(f"        -> {finding.advice}")
    return lines


def _verdict(diagnosis: Diagnosis) -> str:
    if diagnosis.exit_code == 2:
        return "cannot be used as it is"
    state = "with warnings" if diagnosis.exit_code else "nothing wrong"
    return f"{count_of(diagnosis.readings, 'reading')} can be used, {state}"


def counted(
    severity: Severity,
    where: str,
    what: str,
    rows: NDArray[np.bool_],
    stamps: Ints,
    advice: str = "",
) -> list[Finding]:
    """Return a finding about the marked messages, or none; `{count}` in `what` is filled in."""
    count = int(np.count_nonzero(rows))
    if not count:
        return []
    text = what.replace("{count}", str(count)).replace("{total}", str(len(rows)))
    return [Finding(severity, where, text, advice, count, int(stamps[np.argmax(rows)]))]


def topic_facts(topic: Topic, stamps: Ints | None, frame: str = "") -> TopicFacts:
    """Return the statistics of a topic, with those of its stamps where they are known."""
    told = topic.name, topic.msgtype, topic.count, topic.rate_hz
    if stamps is None or not len(stamps):
        return TopicFacts(*told)
    ordered = np.sort(stamps)
    histogram: tuple[tuple[float, int], ...] = ()
    if len(ordered) > 1:
        counts, edges = np.histogram(np.diff(ordered) * 1e-9, bins=10)
        histogram = tuple(zip(edges[1:].tolist(), counts.tolist(), strict=True))
    return TopicFacts(*told, frame, int(ordered[0]), int(ordered[-1]), histogram)
