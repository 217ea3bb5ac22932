# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Counts in words."""

from __future__ import annotations

from slarm_graph.counts import count_of


def test_nouns_agree_with_their_counts() -> None:
    assert [count_of(n, "reading") for n in (0, 1, 2)] == ["no readings", "1 reading", "2 readings"]
    assert count_of(3, "stretch", "stretches") == "3 stretches"
    assert count_of(1, "stretch", "stretches") == "1 stretch"
