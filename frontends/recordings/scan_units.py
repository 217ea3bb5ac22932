# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of scans in other units to metres and radians."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.geometry import Floats

USUAL_MOST_M = 100.0
"""Largest plausible median of returns [m]: planar lidars reach 60 to 80 m at most; a room in
millimetres or centimetres is beyond it."""
MOST_SPAN_RAD = 8 * math.pi
"""Largest plausible span: a turn, of some drivers two; 90 degrees taken for radians are 14."""
_FEW_WITHIN = 0.05
"""Share of ranges within the limits below which the limits are in another unit than the ranges:
where ranges beyond them are a code for `no return`, real returns are more than these few."""


def measured(table: ScanTable, config: SourceConfig, topic: str) -> ScanTable:
    """Return scans in metres and radians.

    Raises
    ------
    BadInput
        When they cannot be in these units.
    """
    blocks = [
        in_si_units(block, config.range_unit_m, config.angle_unit_rad) for block in table.blocks
    ]
    if told := other_units(blocks):
        raise BadInput(f"{topic}: {told}")
    return ScanTable(blocks)


def in_si_units(block: ScanBlock, range_unit_m: float, angle_unit_rad: float) -> ScanBlock:
    """Convert recorded ranges and angles to metres and radians.

    Range limits that are implausible in metres are in the unit of the ranges.
    """
    if range_unit_m == 1.0 and angle_unit_rad == 1.0:
        return block
    limits = np.array(block.limits, np.float64)
    limits[:, :3] *= angle_unit_rad
    also = limits[:, 6] > USUAL_MOST_M
    limits[also, 5:7] *= range_unit_m
    return replace(block, limits=limits, ranges_m=block.ranges_m * np.float32(range_unit_m))


def other_units(blocks: Sequence[ScanBlock]) -> str:
    """Return a notice where ranges or angles cannot be metres and radians; else empty."""
    if not blocks:
        return ""
    limits = np.concatenate([block.limits for block in blocks])
    spans = np.concatenate([_span_rad(block) for block in blocks])
    if np.median(spans) > MOST_SPAN_RAD:
        return (
            f"most scans span {np.median(spans):.4g} rad: are the angles degrees? "
            "set --set source.angle_unit_rad=0.0174533"
        )
    some = [block.ranges_m[:: max(1, len(block) // 50)] for block in blocks]
    ranges = np.concatenate([part[np.isfinite(part) & (part > 0)] for part in some])
    usual_m = float(np.median(ranges)) if len(ranges) else 0.0
    in_limits = np.median(limits[:, 6]) > USUAL_MOST_M
    near = np.mean(ranges <= np.median(limits[:, 6])) if len(ranges) else 1.0
    if usual_m < USUAL_MOST_M or not (in_limits or near < _FEW_WITHIN):
        return ""
    return (
        f"most ranges are around {usual_m:.4g} m: no lidar sees so far. Are they millimetres "
        "(or centimetres)? set --set source.range_unit_m=0.001 (or 0.01)"
    )


def _span_rad(block: ScanBlock) -> Floats:
    with np.errstate(invalid="ignore", over="ignore"):
        span = np.abs(block.limits[:, 2]) * max(block.ranges_m.shape[1] - 1, 0)
    return np.asarray(np.where(np.isfinite(span), span, 0.0))
