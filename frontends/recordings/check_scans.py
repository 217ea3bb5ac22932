# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of laser scans, except their stamps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.frontends.recordings.check_time import Jumps, check_stamps
from slarm_graph.frontends.recordings.findings import Finding, counted
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.ranges import (
    clean_ranges,
    count_returns,
    stated_limits,
    usable_limits,
)
from slarm_graph.frontends.recordings.scan_rules import (
    AT_THE_LIMIT,
    MAX_EMPTY_SHARE,
    SWEEPS_IGNORED,
    at_the_limit,
    repeats,
    sweeps,
    too_few_beams,
)
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.geometry import Floats

_NOTED_SHARE = 0.2
"""Share of all ranges: a value so common is a code of the driver. A choice; only for a note."""


def check_scans(where: str, recorded: list[ScanBlock], config: SourceConfig) -> list[Finding]:
    """Check all scans of a topic, with the limits and the segment that a run would use."""
    blocks = [
        replace(block, limits=stated_limits(block.limits, config, columns=(5, 6)))
        for block in recorded
    ]
    table = ScanTable(blocks)
    limits = table.flat([block.limits for block in blocks])
    beams = table.flat([np.full(len(b), b.ranges_m.shape[1]) for b in blocks])
    jumps = Jumps.of_scans(table.stamp_ns, config.segment)
    rows = jumps.rows(table.stamp_ns)
    found = check_stamps(where, table.stamp_ns[rows], table.record_ns[rows], jumps, "scan")
    found += _check_limits(where, limits, table)
    found += _check_angles(where, limits, beams, table)
    found += _check_sweep(where, table)
    found += _check_ranges(where, table)
    return found + _check_repetition(where, table)


def _check_limits(where: str, limits: Floats, table: ScanTable) -> list[Finding]:
    low, high = limits[:, 5], limits[:, 6]
    bad = np.isnan(usable_limits(limits[:, 5:7])[:, 0])
    first = int(np.argmax(bad))
    return counted(
        "error" if bad.all() else "warning", where,
        f"{{count}} of {{total}} scans with impossible limits, range_min {low[first]:g} and "
        f"range_max {high[first]:g}",
        bad, table.stamp_ns, "set --set source.range_min_m=... and source.range_max_m=...",
    )  # fmt: skip


def _check_angles(where: str, limits: Floats, beams: Floats, table: ScanTable) -> list[Finding]:
    start, end, step = limits[:, 0], limits[:, 1], limits[:, 2]
    with np.errstate(invalid="ignore", over="ignore"):
        span = np.abs(step) * np.maximum(beams - 1, 0)
        last = start + step * np.maximum(beams - 1, 0)
        off = np.abs(last - end) > 1.5 * np.abs(step)
    found = counted(
        "warning", where, "{count} of {total} scans without an angle between beams",
        (step == 0) & (beams > 1), table.stamp_ns,
        "angle_increment is derived from angle_max, where that is set",
    )  # fmt: skip
    found += counted(
        "note", where, "{count} of {total} scans ending elsewhere than angle_max says",
        off, table.stamp_ns,
        "angle_max is not used; beams are counted from angle_min",
    )  # fmt: skip
    found += counted(
        "note", where, "{count} of {total} scans spanning more than a full turn",
        span > 2 * math.pi + 0.5 * np.abs(step), table.stamp_ns,
        "the beams seen twice are kept",
    )  # fmt: skip
    if beams.min() != beams.max():
        told = f"beam count varies: {beams.min():.0f} ... {beams.max():.0f}"
        told += f", usually {np.median(beams):.0f}"
        found.append(Finding("note", where, told, "any count is fine", len(beams)))
    return found


def _check_sweep(where: str, table: ScanTable) -> list[Finding]:
    found = sweeps(table)
    return counted(
        "warning", where, found.describe(), found.ignored, table.stamp_ns,
        f"time_increment is wrong; {SWEEPS_IGNORED}",
    )  # fmt: skip


def _check_ranges(where: str, table: ScanTable) -> list[Finding]:
    total = 0
    kinds = dict.fromkeys(("+inf", "nan", "0", "range_max + 1"), 0)
    cleaned = []
    for block in table.blocks:
        r, high = block.ranges_m, block.limits[:, 6:7].astype(np.float32)
        with np.errstate(invalid="ignore"):
            kinds["+inf"] += int(np.count_nonzero(np.isposinf(r)))
            kinds["nan"] += int(np.count_nonzero(np.isnan(r)))
            kinds["0"] += int(np.count_nonzero(r == 0))
            kinds["range_max + 1"] += int(np.count_nonzero(r == high + 1))
        cleaned.append(clean_ranges(r, usable_limits(block.limits[:, 5:7]), clear_on_inf=True))
        total += r.size
    counts = table.flat([count_returns(part) for part in cleaned])
    empty = counts == 0
    severe = np.count_nonzero(empty) > MAX_EMPTY_SHARE * len(empty)
    found = counted(
        "error" if severe else "warning", where, "{count} of {total} scans without a return",
        empty, table.stamp_ns, "they are not used",
    )  # fmt: skip
    if not severe and (few := too_few_beams(counts[~empty])):
        found.append(Finding("warning", where, few, "more beams, or good odometry, are needed"))
    if walls := at_the_limit(table.blocks, cleaned):
        found.append(Finding("warning", where, walls, AT_THE_LIMIT))
    for kind, count in kinds.items():
        if count > _NOTED_SHARE * max(total, 1):
            found.append(_common_value(where, kind, count / total))
    return found


def _common_value(where: str, kind: str, share: float) -> Finding:
    advice = {
        "+inf": "taken as clear up to range_max (REP-117); --set source.clear_on_inf=false if not",
        "nan": "says nothing; these beams are not used",
        "0": "taken as invalid",
        "range_max + 1": "a code for `no return`; taken as invalid",
    }[kind]
    return Finding("note", where, f"{share:.0%} of all beams are {kind}", advice)


def _check_repetition(where: str, table: ScanTable) -> list[Finding]:
    if len(table) < 3:
        return []
    first = repeats(table, np.arange(len(table)))
    if not first.any():
        told = "the scan data never change"
        return [Finding("warning", where, told, "is the driver stuck?", len(table))]
    return counted(
        "note", where, "{count} of {total} scans repeating the one before",
        first != np.arange(len(first)), table.stamp_ns,
        "a simulator or a re-publisher; while the robot moves they are not used",
    )  # fmt: skip
