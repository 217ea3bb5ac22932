# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Put the scans and the odometry of a recording together into readings in time order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.clock import choose_segment, disorder, seconds
from slarm_graph.frontends.messages import ScanBlock
from slarm_graph.frontends.mounting import Mounting
from slarm_graph.frontends.odometry import OdometryPath
from slarm_graph.frontends.packed import Ints
from slarm_graph.frontends.ranges import (
    clean_ranges,
    count_returns,
    describe_emptiness,
    range_limits,
)
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading, ScanStatus, SourceInfo

MountingAt = Callable[[str, Ints], Sequence[Mounting | None]]
"""Where the laser of a frame sits at some stamps; None where that is unknown."""

_MAX_UNUSED_SHARE = 0.5
_NOTICED_UNUSED_SHARE = 0.05
_MAX_EMPTY_SHARE = 0.9


class ScanTable:
    """All scans of a topic in recorded order, whatever their beam counts.

    Parameters
    ----------
    blocks : sequence of ScanBlock
        Their `index` counts over the whole recording.
    """

    def __init__(self, blocks: Sequence[ScanBlock]) -> None:
        self.blocks = list(blocks)
        index = _joined([block.index for block in blocks])
        order = np.argsort(index, kind="stable")
        self.block = _joined([np.full(len(b), k, np.int64) for k, b in enumerate(blocks)])[order]
        self.row = _joined([np.arange(len(block)) for block in blocks])[order]
        self.stamp_ns = _joined([block.stamp_ns for block in blocks])[order]
        self.record_ns = _joined([block.record_ns for block in blocks])[order]

    def __len__(self) -> int:
        return len(self.stamp_ns)


class RecordedSource:
    """Readings of a recording; everything is decided when it is built, before the first one.

    Parameters
    ----------
    table : ScanTable
    odometry : OdometryPath or None
        None when there is none, or when it was logged with the scans.
    mounting_at : MountingAt
    config : SourceConfig
    topic, description : str
        For messages.
    notices : sequence of str
        What is already known.

    Raises
    ------
    BadInput
        When most scans cannot be used; the message says why.
    """

    def __init__(
        self,
        table: ScanTable,
        odometry: OdometryPath | None,
        mounting_at: MountingAt,
        *,
        config: SourceConfig,
        topic: str,
        description: str,
        notices: Sequence[str] = (),
    ) -> None:
        self._table, self._config, self._topic = table, config, topic
        self._notices = list(notices)
        self._reasons: list[str] = [""] * len(table)
        self._stamps = self._choose_stamps()
        rows = self._in_time_order()
        self._clean(rows)
        self._place(rows, mounting_at)
        self._rows = np.array([r for r in rows.tolist() if not self._reasons[r]], np.int64)
        self._judge()
        self._poses, self._known = self._odometry_at(odometry)
        self._info = SourceInfo(description, len(self._rows), tuple(self._notices))

    def info(self) -> SourceInfo:
        """Describe the source."""
        return self._info

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        """Return every recorded scan with its fate, in time order."""
        order = np.argsort(self._stamps, kind="stable").tolist()
        stamps = self._stamps.tolist()
        return tuple(ScanStatus(stamps[row], self._reasons[row]) for row in order)

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Reading]:
        """Yield readings, strictly increasing in stamp."""
        poses, known = self._poses.tolist(), self._known.tolist()
        stamps = self._stamps[self._rows].tolist()
        blocks, lines = (a[self._rows].tolist() for a in (self._table.block, self._table.row))
        limits = [block.tolist() for block in self._limits]
        for number, row in enumerate(self._rows.tolist()):
            block, line = blocks[number], lines[number]
            angle_min, increment, time_increment, low, high = limits[block][line]
            mounting = self._mountings[row]
            scan = LaserScan(
                self._ranges[block][line],
                mounting.angle_sign * angle_min,
                mounting.angle_sign * increment,
                low,
                high,
                mounting.robot_from_laser,
                time_increment,
            )
            pose = Pose2(*poses[number]) if known[number] else None
            yield Reading(stamps[number], scan, pose)

    def _choose_stamps(self) -> Ints:
        """Header stamps, or record times when the sensor never set its clock."""
        stamps = self._table.stamp_ns
        if len(stamps) and not stamps.any():
            self._notices.append(
                f"all {len(stamps)} stamps in {self._topic} are 0: using the time of recording"
            )
            return self._table.record_ns
        for row in np.flatnonzero(stamps == 0).tolist():
            self._reasons[row] = "stamp is 0"
        return stamps

    def _in_time_order(self) -> Ints:
        """Rows still in use, sorted by stamp; scans of other segments and doubles are told off."""
        usable = np.array([not reason for reason in self._reasons], bool)
        rows = np.flatnonzero(usable)
        start, stop = choose_segment(self._stamps[rows], self._config.segment, "scan")
        for row in [*rows[:start].tolist(), *rows[stop:].tolist()]:
            self._reasons[row] = f"not in segment {self._config.segment}"
        rows = rows[start:stop]
        self._notices += disorder(self._stamps[rows]).describe("scans")
        rows = rows[np.argsort(self._stamps[rows], kind="stable")]
        again = np.flatnonzero(np.diff(self._stamps[rows]) == 0) + 1
        for number in again.tolist():
            self._reasons[rows[number]] = self._repeated(rows[number - 1], rows[number])
        keep = np.ones(len(rows), bool)
        keep[again] = False
        return rows[keep]

    def _repeated(self, first: int, second: int) -> str:
        same = np.array_equal(self._recorded(first), self._recorded(second), equal_nan=True)
        return "duplicate of the scan before" if same else "same stamp as another scan"

    def _recorded(self, row: int) -> NDArray[np.float32]:
        table = self._table
        return table.blocks[table.block[row]].ranges_m[table.row[row]]

    def _clean(self, rows: Ints) -> None:
        """Apply REP-117 block by block; scans without limits or returns are told off."""
        self._ranges: list[NDArray[np.float32]] = []
        self._limits: list[Floats] = []
        returns = []
        recorded = [block.limits[:, 5:7] for block in self._table.blocks]
        limits = range_limits(
            np.concatenate([np.zeros((0, 2)), *recorded]), self._config, self._topic
        )
        ends = np.cumsum([len(part) for part in recorded])[:-1]
        for block, part in zip(self._table.blocks, np.split(limits, ends), strict=True):
            cleaned = clean_ranges(block.ranges_m, part, clear_on_inf=self._config.clear_on_inf)
            self._ranges.append(cleaned)
            returns.append(count_returns(cleaned))
            self._limits.append(np.column_stack([block.limits[:, [0, 2]], _sweep(block), part]))
        empty = 0
        for row in rows.tolist():
            block, line = self._table.block[row], self._table.row[row]
            if np.isnan(self._limits[block][line][-1]):
                self._reasons[row] = "range limits leave no range"
            elif not returns[block][line]:
                empty += 1
                self._reasons[row] = f"no valid beam ({describe_emptiness(self._recorded(row))})"
        if len(rows) and empty > _MAX_EMPTY_SHARE * len(rows):
            row = next(r for r in rows.tolist() if self._reasons[r].startswith("no valid beam"))
            raise BadInput(
                f"{self._topic}: {empty} of {len(rows)} scans have no return; first: scan "
                f"t={seconds(self._stamps[row])}: {self._reasons[row]}"
            )

    def _place(self, rows: Ints, mounting_at: MountingAt) -> None:
        self._mountings: list[Mounting] = [Mounting()] * len(self._table)
        for frame in dict.fromkeys(block.frame for block in self._table.blocks):
            of_frame = np.array([block.frame == frame for block in self._table.blocks], bool)
            some = rows[of_frame[self._table.block[rows]]]
            if not some.size:
                continue
            found = mounting_at(frame, self._stamps[some])
            for row, mounting in zip(some.tolist(), found, strict=True):
                if mounting is not None:
                    self._mountings[row] = mounting
                elif not self._reasons[row]:
                    self._reasons[row] = f"no transform from {frame} at this stamp"
            self._notices += next((m.describe(frame) for m in found if m is not None), [])

    def _odometry_at(self, odometry: OdometryPath | None) -> tuple[Floats, NDArray[np.bool_]]:
        stamps = self._stamps[self._rows]
        logged = [block.odom_from_robot for block in self._table.blocks]
        if odometry is None and logged and all(poses is not None for poses in logged):
            poses = [
                logged[self._table.block[row]][self._table.row[row]]  # type: ignore[index]
                for row in self._rows.tolist()
            ]
            return np.array(poses).reshape(-1, 3), np.ones(len(stamps), bool)
        if odometry is None:
            return np.zeros((len(stamps), 3)), np.zeros(len(stamps), bool)
        poses, known = odometry.at(stamps, self._config.max_odom_gap_s)
        if not known.all():
            first = int(np.argmin(known))
            self._notices.append(
                f"{np.count_nonzero(~known)} of {len(known)} scans have no odometry within "
                f"{self._config.max_odom_gap_s:g} s, first at {seconds(stamps[first])}: "
                "scan matching only there"
            )
        return poses, known

    def _judge(self) -> None:
        """Count what is not used; too much of it is bad input."""
        counts = Counter(reason.split(" (")[0] for reason in self._reasons if reason)
        unused, total = sum(counts.values()), len(self._reasons)
        if not unused:
            return
        told = ", ".join(f"{count} {reason}" for reason, count in counts.most_common())
        text = f"{unused} of {total} scans not used: {told}"
        others = sum(n for reason, n in counts.items() if reason.startswith("not in segment"))
        if unused - others > _MAX_UNUSED_SHARE * (total - others):
            raise BadInput(f"{self._topic}: {text}")
        warning = unused - others > _NOTICED_UNUSED_SHARE * (total - others)
        self._notices.append(f"warning: {text}" if warning else text)


def _sweep(block: ScanBlock) -> Floats:
    """Time between beams [s], (N,): as recorded, else the scan's duration shared out."""
    increment, duration = block.limits[:, 3], block.limits[:, 4]
    beams = max(block.ranges_m.shape[1], 1)
    with np.errstate(invalid="ignore"):
        shared = np.where(duration > 0, duration / beams, 0.0)
        return np.asarray(np.where(increment > 0, increment, shared))


def _joined(parts: list[Ints]) -> Ints:
    return np.concatenate([np.zeros(0, np.int64), *parts])
