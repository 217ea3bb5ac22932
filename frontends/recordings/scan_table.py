# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""All scans of a topic in recorded order, of any beam counts, and which of them are used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.geometry import Floats

Scalar = TypeVar("Scalar", bound=np.generic)

MOST_ANGLE_RAD = 100.0
"""Largest plausible angle [rad]; larger ones are degrees taken for radians, or damage."""


class ScanTable:
    """Scans as columns (N,), over blocks of equal beam count.

    Parameters
    ----------
    blocks : sequence of ScanBlock
        At least one. Their `index` counts over the whole recording.

    Attributes
    ----------
    stamp_ns, record_ns : (N,) int64
    block, line : (N,) int64
        Where each scan's ranges are: `blocks[block].ranges_m[line]`.
    """

    def __init__(self, blocks: Sequence[ScanBlock]) -> None:
        self.blocks = list(blocks)
        index = np.concatenate([block.index for block in blocks])
        self._order = np.argsort(index, kind="stable")
        self.block = self.flat([np.full(len(b), k) for k, b in enumerate(blocks)])
        self.line = self.flat([np.arange(len(block)) for block in blocks])
        self.stamp_ns = self.flat([block.stamp_ns for block in blocks])
        self.record_ns = self.flat([block.record_ns for block in blocks])

    def __len__(self) -> int:
        return len(self._order)

    def flat(self, parts: Sequence[NDArray[Scalar]]) -> NDArray[Scalar]:
        """Join one array per block, (B_k, ...), into one over all scans, (N, ...)."""
        return np.asarray(np.concatenate(parts)[self._order])

    def recorded(self, row: int) -> NDArray[np.float32]:
        """Return the ranges (B,) of one scan as recorded [m]."""
        return np.asarray(self.blocks[self.block[row]].ranges_m[self.line[row]])

    def frames(self) -> dict[str, Ints]:
        """Return the rows of every laser frame."""
        names = [block.frame for block in self.blocks]
        return {
            name: np.flatnonzero(np.array([other == name for other in names])[self.block])
            for name in dict.fromkeys(names)
        }


class ScanSelection:
    """The status of every scan: used, or the reason why it was dropped."""

    def __init__(self, count: int) -> None:
        self.used = np.ones(count, bool)
        self.reasons: dict[int, str] = {}

    def drop(self, rows: Iterable[int] | Ints, reason: str) -> None:
        """Drop scans; the first reason is kept."""
        for row in np.asarray(rows, np.int64).ravel().tolist():
            self.used[row] = False
            self.reasons.setdefault(row, reason)

    def counts(self) -> Counter[str]:
        """Return the number of dropped scans per reason, without details in brackets."""
        return Counter(reason.split(" (")[0] for reason in self.reasons.values())


def beam_angles(block: ScanBlock) -> Floats:
    """Angle of the first beam and between beams [rad], (N, 2).

    Where angle_increment is missing it follows from angle_max; nan where that does not help.
    """
    start, end, step = (block.limits[:, column] for column in range(3))
    intervals = block.ranges_m.shape[1] - 1
    if intervals > 0:
        with np.errstate(invalid="ignore", over="ignore"):
            derived = (end - start) / intervals
        step = np.where(step == 0, np.where(derived == 0, np.nan, derived), step)
    sensible = (np.abs(start) <= MOST_ANGLE_RAD) & (np.abs(step) <= MOST_ANGLE_RAD)
    step = np.where(sensible, step, np.nan)
    return np.column_stack([start, step])


def recorded_beam_period_s(block: ScanBlock) -> Floats:
    """Time between beams [s], (N,): as recorded, else the scan's duration shared out."""
    increment, duration = block.limits[:, 3], block.limits[:, 4]
    beams = max(block.ranges_m.shape[1], 1)
    with np.errstate(invalid="ignore"):
        shared = np.where(duration > 0, duration / beams, 0.0)
        return np.asarray(np.where(increment > 0, increment, shared))
