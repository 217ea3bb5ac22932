# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics of a recording in numbers, for its diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slarm_graph.frontends.recordings.findings import TopicFacts, step_histogram
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.recordings import Topic


def topic_facts(topic: Topic, stamps: Ints | None, frame: str) -> TopicFacts:
    """Put a topic's sorted stamps into numbers."""
    if stamps is None or not len(stamps):
        return TopicFacts(topic.name, topic.msgtype, topic.count, topic.rate_hz)
    return TopicFacts(
        topic.name, topic.msgtype, topic.count, topic.rate_hz, frame,
        int(stamps[0]), int(stamps[-1]), step_histogram(stamps),
    )  # fmt: skip


def sorted_stamps(blocks: Sequence[ScanBlock]) -> Ints:
    """Return the stamps of all scans of a topic in order [ns]."""
    return np.sort(np.concatenate([block.stamp_ns for block in blocks]))
