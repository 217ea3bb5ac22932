# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What may be wrong with laser scans, beyond their stamps."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.recordings.check_time import check_stamps
from slarm_graph.frontends.recordings.findings import Finding, Severity, counted
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.geometry import Floats

_NOTED_SHARE = 0.2
_MAX_EMPTY_SHARE = 0.9


def check_scans(where: str, blocks: list[ScanBlock]) -> list[Finding]:
    """Look at all scans of a topic."""
    table = ScanTable(blocks)
    limits = table.flat([block.limits for block in blocks])
    beams = table.flat([np.full(len(b), b.ranges_m.shape[1]) for b in blocks])
    stamps = table.stamp_ns
    found = check_stamps(where, stamps, table.record_ns)
    found += _check_limits(where, limits, table)
    found += _check_angles(where, limits, beams, table)
    found += _check_sweep(where, limits, beams, table)
    found += _check_ranges(where, table)
    return found + _check_repetition(where, table)


def _check_limits(where: str, limits: Floats, table: ScanTable) -> list[Finding]:
    low, high = limits[:, 5], limits[:, 6]
    with np.errstate(invalid="ignore"):
        bad = ~((high > 0) & (high > low) & (low >= 0))
    first = int(np.argmax(bad))
    return counted(
        "error" if bad.all() else "warning", where,
        f"{{count}} of {{total}} scans have impossible limits, range_min {low[first]:g} and "
        f"range_max {high[first]:g}",
        bad, table.stamp_ns, "set --set source.range_min_m=... and source.range_max_m=...",
    )  # fmt: skip


def _check_angles(where: str, limits: Floats, beams: Floats, table: ScanTable) -> list[Finding]:
    start, end, step = limits[:, 0], limits[:, 1], limits[:, 2]
    span = np.abs(step) * np.maximum(beams - 1, 0)
    last = start + step * np.maximum(beams - 1, 0)
    found = counted(
        "warning", where, "{count} of {total} scans have no angle between beams",
        (step == 0) & (beams > 1), table.stamp_ns,
        "angle_increment is derived from angle_max, where that is set",
    )  # fmt: skip
    found += counted(
        "note", where, "{count} of {total} scans end elsewhere than angle_max says",
        np.abs(last - end) > 1.5 * np.abs(step), table.stamp_ns,
        "angle_max is not used; beams are counted from angle_min",
    )  # fmt: skip
    found += counted(
        "note", where, "{count} of {total} scans span more than a full turn",
        span > 2 * math.pi + 0.5 * np.abs(step), table.stamp_ns,
        "the beams seen twice are kept",
    )  # fmt: skip
    if beams.min() != beams.max():
        told = f"beam count varies: {beams.min():.0f} ... {beams.max():.0f}"
        told += f", usually {np.median(beams):.0f}"
        found.append(Finding("note", where, told, "any count is fine", len(beams)))
    return found


def _check_sweep(where: str, limits: Floats, beams: Floats, table: ScanTable) -> list[Finding]:
    if len(table) < 3:
        return []
    period_s = float(np.median(np.diff(np.sort(table.stamp_ns)))) * 1e-9
    return counted(
        "warning", where,
        f"{{count}} of {{total}} scans last longer than the {period_s:.3f} s between scans "
        "(time_increment x beams)",
        limits[:, 3] * beams > 1.5 * max(period_s, 1e-9), table.stamp_ns,
        "time_increment is wrong; do not correct for motion within scans: "
        "--set frontend.deskew=false",
    )  # fmt: skip


def _check_ranges(where: str, table: ScanTable) -> list[Finding]:
    total = 0
    kinds = dict.fromkeys(("+inf", "nan", "0", "exactly range_max", "range_max + 1"), 0)
    returns = []
    for block in table.blocks:
        r, high = block.ranges_m, block.limits[:, 6:7].astype(np.float32)
        with np.errstate(invalid="ignore"):
            good = (r >= block.limits[:, 5:6].astype(np.float32)) & (r <= high)
            kinds["+inf"] += int(np.count_nonzero(np.isposinf(r)))
            kinds["nan"] += int(np.count_nonzero(np.isnan(r)))
            kinds["0"] += int(np.count_nonzero(r == 0))
            kinds["exactly range_max"] += int(np.count_nonzero(r == high))
            kinds["range_max + 1"] += int(np.count_nonzero(r == high + 1))
        returns.append(np.asarray(good.any(axis=1)))
        total += r.size
    empty = ~table.flat(returns)
    severe = np.count_nonzero(empty) > _MAX_EMPTY_SHARE * len(empty)
    found = counted(
        "error" if severe else "warning", where, "{count} of {total} scans have no return",
        empty, table.stamp_ns, "they are not used",
    )  # fmt: skip
    for kind, count in kinds.items():
        if count > _NOTED_SHARE * max(total, 1):
            found.append(_common_value(where, kind, count / total))
    return found


def _common_value(where: str, kind: str, share: float) -> Finding:
    advice = {
        "+inf": "taken as clear up to range_max (REP-117); --set source.clear_on_inf=false if not",
        "nan": "says nothing; these beams are not used",
        "0": "taken as invalid",
        "exactly range_max": "looks like a code for `no return`: walls appear where there are "
        "none; set source.range_max_m slightly lower",
        "range_max + 1": "a code for `no return`; taken as invalid",
    }[kind]
    severity: Severity = "warning" if kind == "exactly range_max" else "note"
    return Finding(severity, where, f"{share:.0%} of all beams are {kind}", advice)


def _check_repetition(where: str, table: ScanTable) -> list[Finding]:
    if len(table) < 3:
        return []
    same = np.zeros(len(table), bool)
    for row in range(1, len(table)):
        one, other = table.recorded(row - 1), table.recorded(row)
        same[row] = one.shape == other.shape and one.tobytes() == other.tobytes()
    if same[1:].all():
        return [
            Finding(
                "warning", where, "the scan data never change", "is the driver stuck?", len(table)
            )
        ]
    return counted(
        "note", where, "{count} of {total} scans repeat the one before", same, table.stamp_ns,
        "a simulator or a re-publisher",
    )  # fmt: skip
