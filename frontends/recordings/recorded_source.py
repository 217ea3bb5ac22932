# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The source of readings of a recording: its scans with the odometry, in time order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import SourceConfig
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.clock import choose_segment, disorder, gap_notice, seconds
from slarm_graph.frontends.recordings.mounting import Mounting
from slarm_graph.frontends.recordings.odometry import OdometryPath, outliers, places
from slarm_graph.frontends.recordings.odometry_agreement import disagreement
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.ranges import (
    clean_ranges,
    count_returns,
    describe_emptiness,
    range_limits,
)
from slarm_graph.frontends.recordings.scan_rules import (
    AT_THE_LIMIT,
    MAX_EMPTY_SHARE,
    SWEEPS_IGNORED,
    at_the_limit,
    far_off,
    frozen,
    repeats,
    sweeps,
    too_few_beams,
    too_many_beams,
)
from slarm_graph.frontends.recordings.scan_table import (
    ScanSelection,
    ScanTable,
    beam_angles,
)
from slarm_graph.frontends.recordings.scan_units import measured
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading, ScanStatus, SourceInfo

MountingAt = Callable[[str, Ints], Sequence[Mounting | None]]
"""Returns the mounting of a laser frame at stamps; None where it is unknown."""


def fixed(mounting: Mounting) -> MountingAt:
    """Return a function that gives every laser the same mounting at all times."""
    return lambda _frame, stamps_ns: [mounting] * len(stamps_ns)


_MAX_UNUSED_SHARE, _NOTICED_UNUSED_SHARE = 0.5, 0.05
"""Of scans: with more than half unusable a run is refused, from a twentieth on it is a warning."""
_FROZEN = "repeats an earlier scan to the bit although the robot moves"


class RecordedSource:
    """Readings of a recording; all scans are checked when it is built, before the first reading.

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
        Notices so far.

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
        self._table, self._config, self._topic = measured(table, config, topic), config, topic
        self._notices = list(notices)
        self._selection = ScanSelection(len(table))
        self._sweeps = sweeps(self._table, believed=config.sweep_times)
        self._stamps = self._choose_stamps()
        rows = self._in_time_order()
        self._ranges, self._limits = self._clean(rows)
        self._mountings = self._place(rows, mounting_at)
        self._rows = rows[self._selection.used[rows]]
        self._poses, self._known = self._odometry_at(odometry)
        self._drop_frozen()
        self._check_unused()
        self._compared = False
        self._info = SourceInfo(description, len(self._rows), tuple(self._notices))

    def info(self) -> SourceInfo:
        """Describe the source."""
        return self._info

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        """Return the status of every recorded scan, in time order."""
        order, reasons = np.argsort(self._stamps, kind="stable"), self._selection.reasons
        return tuple(
            ScanStatus(stamp, reasons.get(row, ""))
            for stamp, row in zip(self._stamps[order].tolist(), order.tolist(), strict=True)
        )

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Reading]:
        """Yield readings, strictly increasing in stamp."""
        rows, table = self._rows, self._table
        # Columns of plain numbers: one list per scan would keep the garbage collector busy.
        for row, stamp, block, line, start, step, sweep, low, high, x, y, theta, known in zip(
            rows.tolist(),
            self._stamps[rows].tolist(),
            table.block[rows].tolist(),
            table.line[rows].tolist(),
            *self._limits[rows].T.tolist(),
            *self._poses.T.tolist(),
            self._known.tolist(),
            strict=True,
        ):
            ranges_m = self._ranges[block][line]
            scan = self._mountings[row].scan(ranges_m, start, step, sweep, low, high)
            yield Reading(stamp, scan, Pose2(x, y, theta) if known else None)
        self._compare()

    def _compare(self) -> None:
        """Check once whether scans and odometry agree, and add a notice where they do not."""
        if self._compared:
            return
        self._compared = True
        if self._stuck:
            return
        told = disagreement(self._scan, self._poses, self._known)
        if told:
            notices = (*self._info.notices, f"warning: {told}")
            self._info = replace(self._info, notices=notices)

    def _scan(self, number: int) -> LaserScan:
        """The scan of a reading."""
        row = int(self._rows[number])
        ranges_m = self._ranges[self._table.block[row]][self._table.line[row]]
        return self._mountings[row].scan(ranges_m, *self._limits[row].tolist())

    def _choose_stamps(self) -> Ints:
        """Return stamps of the first beam; record times where header stamps were never set."""
        stamps = self._table.stamp_ns
        if len(stamps) and not stamps.any():
            self._notices.append(f"all stamps in {self._topic} are 0: using the time of recording")
            return self._table.record_ns
        self._selection.drop(np.flatnonzero(stamps == 0), "stamp is 0")
        self._selection.drop(np.flatnonzero(far_off(stamps)), "stamp is more than a week off")
        if self._sweeps.ignored.any():
            self._notices.append(f"warning: {self._sweeps.describe()}; {SWEEPS_IGNORED}")
        share = {"first": 0.0, "middle": 0.5, "last": 1.0}[self._config.stamp_at]
        intervals = self._table.flat(
            [np.full(len(b), max(b.ranges_m.shape[1] - 1, 0)) for b in self._table.blocks]
        )
        return stamps - np.round(1e9 * share * intervals * self._sweeps.beam_period_s).astype(
            np.int64
        )

    def _in_time_order(self) -> Ints:
        """Return the rows still in use, sorted by stamp, each stamp once."""
        rows = np.flatnonzero(self._selection.used)
        start, stop = choose_segment(self._stamps[rows], self._config.segment, "scan")
        elsewhere = f"not in segment {self._config.segment}"
        self._selection.drop(np.concatenate([rows[:start], rows[stop:]]), elsewhere)
        rows = rows[start:stop]
        self._notices += disorder(self._stamps[rows]).describe("scans")
        rows = rows[np.argsort(self._stamps[rows], kind="stable")]
        steps = np.diff(self._stamps[rows])
        for number in np.flatnonzero(steps == 0).tolist():
            first, second = rows[number : number + 2].tolist()
            self._selection.drop([second], self._repetition(first, second))
        self._notices += gap_notice(self._stamps[rows], steps)
        return rows[self._selection.used[rows]]

    def _repetition(self, first: int, second: int) -> str:
        one, other = self._table.recorded(first), self._table.recorded(second)
        same = np.array_equal(one, other, equal_nan=True)
        return "duplicate of the scan before" if same else "same stamp as another scan"

    def _clean(self, rows: Ints) -> tuple[list[NDArray[np.float32]], Floats]:
        """Clean ranges by REP-117; scans without limits or without returns are dropped.

        Returns
        -------
        ranges : list of (B_k, beams) float32, one per block
        limits : (N, 5)
            angle_min, angle_increment, time between beams, range_min, range_max.
        """
        blocks = self._table.blocks
        recorded = np.concatenate([np.zeros((0, 2)), *(block.limits[:, 5:7] for block in blocks)])
        parts = np.split(
            range_limits(recorded, self._config, self._topic),
            np.cumsum([len(block) for block in blocks])[:-1],
        )
        ranges = [
            clean_ranges(block.ranges_m, part, clear_on_inf=self._config.clear_on_inf)
            for block, part in zip(blocks, parts, strict=True)
        ]
        limits = self._table.flat(
            [
                np.column_stack([beam_angles(block), np.zeros(len(block)), part])
                for block, part in zip(blocks, parts, strict=True)
            ]
        )
        limits[:, 2] = self._sweeps.beam_period_s
        returns = self._table.flat([count_returns(part) for part in ranges])
        self._selection.drop(rows[np.isnan(limits[rows, 4])], "range limits leave no range")
        self._selection.drop(rows[np.isnan(limits[rows, 1])], "no angle between beams")
        crowded = self._table.flat([np.full(len(b), too_many_beams(b)) for b in blocks])
        self._selection.drop(rows[crowded[rows]], "more beams than any lidar has")
        self._drop_empty(rows, rows[returns[rows] == 0])
        if few := too_few_beams(returns[rows[self._selection.used[rows]]]):
            self._notices.append(f"warning: {self._topic}: {few}")
        if walls := at_the_limit(blocks, ranges):
            self._notices.append(f"warning: {self._topic}: {walls}; {AT_THE_LIMIT}")
        return ranges, limits

    def _drop_empty(self, rows: Ints, empty: Ints) -> None:
        for row in empty.tolist():
            holds = describe_emptiness(self._table.recorded(row))
            self._selection.drop([row], f"no valid beam ({holds})")
        if len(empty) > MAX_EMPTY_SHARE * len(rows):
            first = int(empty[0])
            raise BadInput(
                f"{self._topic}: {len(empty)} of {count_of(len(rows), 'scan')} without a return;"
                f" first: scan t={seconds(self._stamps[first])}: {self._selection.reasons[first]}"
            )

    def _place(self, rows: Ints, mounting_at: MountingAt) -> list[Mounting]:
        """Find the laser's mounting at every scan; one unknown frame among others is no reason."""
        mountings = [Mounting()] * len(self._table)
        refused: list[BadInput] = []
        frames = {name: rows[np.isin(rows, some)] for name, some in self._table.frames().items()}
        frames = {name: some for name, some in frames.items() if some.size}
        for frame, some in frames.items():
            try:
                found = mounting_at(frame, self._stamps[some])
            except BadInput as error:
                refused.append(error)
                self._selection.drop(some, str(error))
                continue
            for row, mounting in zip(some.tolist(), found, strict=True):
                if mounting is None:
                    self._selection.drop([row], f"no transform from {frame} at its stamp")
                else:
                    mountings[row] = mounting
            self._notices += next((m.describe(frame) for m in found if m is not None), [])
        if refused and len(refused) == len(frames):
            raise refused[0]
        return mountings

    def _odometry_at(self, odometry: OdometryPath | None) -> tuple[Floats, NDArray[np.bool_]]:
        """Poses (M, 3) of the used scans, and which of them are known, (M,)."""
        stamps = self._stamps[self._rows]
        logged = [b.odom_from_robot for b in self._table.blocks if b.odom_from_robot is not None]
        wanted = self._config.odom != "none"
        if odometry is None and wanted and len(logged) == len(self._table.blocks):
            return self._logged_odometry(self._table.flat(logged)[self._rows])
        if odometry is None:
            return np.zeros((len(stamps), 3)), np.zeros(len(stamps), bool)
        gap_s = self._config.max_odom_gap_s or odometry.usual_gap_s()
        poses, known = odometry.at(stamps, gap_s)
        if len(known) and not known.any():
            self._notices.append(
                f"the odometry ({odometry.span()}) does not overlap the scans "
                f"({seconds(stamps[0])} to {seconds(stamps[-1])}): using scan matching only"
            )
        elif not known.all():
            self._notices.append(
                f"{np.count_nonzero(~known)} of {count_of(len(known), 'scan')} outside the odometry"
                f" or in silences of it longer than {gap_s:.2g} s, first at "
                f"{seconds(stamps[np.argmin(known)])}: scan matching only there"
            )
        return poses, known

    def _logged_odometry(self, poses: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Poses (M, 3) logged with the scans in time order, and which of them can be true, (M,)."""
        known = places(poses)
        rows = np.flatnonzero(known)
        known[rows[outliers(self._stamps[self._rows][rows], poses[rows])]] = False
        if not known.all():
            count = np.count_nonzero(~known)
            self._notices.append(
                f"{count} of {count_of(len(known), 'pose')} of the odometry unusable, skipped"
            )
        return np.where(known[:, None], poses, 0.0), known

    def _drop_frozen(self) -> None:
        """Drop scans that repeat an earlier one although the odometry moves.

        Where all scans are equal there is only a notice.
        """
        first = repeats(self._table, self._rows)
        self._stuck = len(first) > 2 and not first.any()
        if self._stuck:
            self._notices.append("warning: the scan data never change; is the laser driver stuck?")
            return
        stuck = frozen(first, self._poses, self._known)
        self._selection.drop(self._rows[stuck], _FROZEN)
        self._rows, self._poses = self._rows[~stuck], self._poses[~stuck]
        self._known = self._known[~stuck]

    def _check_unused(self) -> None:
        """Warn of unused scans; raise BadInput when they are too many."""
        counts = self._selection.counts()
        elsewhere = sum(n for reason, n in counts.items() if reason.startswith("not in segment"))
        total = len(self._table) - elsewhere
        unused = sum(counts.values()) - elsewhere - counts[_FROZEN]
        if not counts:
            return
        told = ", ".join(f"{count} {reason}" for reason, count in counts.most_common())
        text = f"{sum(counts.values())} of {count_of(len(self._table), 'scan')} not used: {told}"
        if unused > _MAX_UNUSED_SHARE * total:
            raise BadInput(f"{self._topic}: {text}")
        self._notices.append(
            f"warning: {text}" if unused + counts[_FROZEN] > _NOTICED_UNUSED_SHARE * total else text
        )
