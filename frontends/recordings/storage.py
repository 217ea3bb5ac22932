# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the storage files of ROS 2 recordings have in common."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

Key = tuple[str, str]
"""Topic and message type."""
Stored = tuple[Key, int, bytes]
"""Topic and type, record time [ns], serialized message."""


class Storage(Protocol):
    """One file with messages.

    Attributes
    ----------
    path : Path
    counts : dict of Key to int
    span_ns : (int, int)
        First and last record time [ns].
    """

    path: Path
    counts: dict[Key, int]
    span_ns: tuple[int, int]

    def messages(self, wanted: Collection[Key]) -> Iterator[Stored]:
        """Yield the messages of some topics in the order of the file."""
        ...

    def notices(self) -> list[str]:
        """Say how the file is damaged, and what that has cost so far."""
        ...


@dataclass(slots=True)
class Losses:
    """Messages that should be there and were not found, by topic."""

    missing: dict[Key, int] = field(default_factory=dict)
    seconds: dict[Key, float] = field(default_factory=dict)

    def note(
        self, found: Mapping[Key, int], counts: Mapping[Key, int], span_ns: tuple[int, int]
    ) -> None:
        """Compare what was found with what there should be."""
        for key, count in found.items():
            expected = counts.get(key, 0)
            self.missing[key] = max(0, expected - count)
            span_s = (span_ns[1] - span_ns[0]) * 1e-9
            self.seconds[key] = self.missing[key] * span_s / max(expected, 1)

    def notices(self, name: str) -> list[str]:
        """One warning, or none."""
        count = sum(self.missing.values())
        if not count:
            return []
        seconds = max(self.seconds.values())
        told = f"{count} messages, about {seconds:.1f} s, could not be read"
        return [f"warning: {name} is damaged: {told}"]
