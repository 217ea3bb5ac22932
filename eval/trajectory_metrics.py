# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The metrics of a trajectory: ATE, RPE, drift, scale and matched share."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import (
    Alignment,
    AlignmentMethod,
    align,
    fit,
    positions,
)
from slarm_graph.eval.association import Pairs
from slarm_graph.eval.bootstrap import rms_interval
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.trajectory_accuracy import (
    Drift,
    StretchUnit,
    absolute_errors,
    absolute_rotations_rad,
    drift,
    relative_errors,
    statistics,
)


def trajectory_metrics(
    pairs: Pairs,
    method: AlignmentMethod = AlignmentMethod.SE2,
    first: int | None = None,
    delta: float = 1.0,
    unit: StretchUnit = "frames",
    lengths_m: tuple[float, ...] = (),
) -> tuple[Metric, ...]:
    """Return ATE aligned and not aligned, RPE over every kind of stretch, and drift as metrics.

    The paper's eq. (14) calls its error MSE and describes the RMSE of the ATE; both are given.
    """
    alignment = align(pairs, method, first)
    return (
        *_absolute_metrics(pairs, alignment),
        *_relative_metrics(pairs, "rpe", alignment.scale, delta, unit),
        *_relative_metrics(pairs, "rpe_metre", alignment.scale, 1.0, "m"),
        *_relative_metrics(pairs, "rpe_second", alignment.scale, 1.0, "s"),
        *_drift_metrics(drift(pairs, lengths_m, alignment.scale)),
        *_extent_metrics(pairs),
    )


def _absolute_metrics(pairs: Pairs, alignment: Alignment) -> tuple[Metric, ...]:
    errors = absolute_errors(pairs, alignment)
    ate, turned = statistics(errors), statistics(absolute_rotations_rad(pairs, alignment))
    unmoved = align(pairs, AlignmentMethod.NONE)
    raw = statistics(absolute_errors(pairs, unmoved))
    raw_turned = statistics(absolute_rotations_rad(pairs, unmoved))
    note, raw_note = f"{alignment.note}, {pairs.note}", f"not aligned, {pairs.note}"
    interval = rms_interval(errors)
    return (
        Metric("ate_rmse_m", ate.rmse, note=note, interval=interval),
        Metric("ate_mean_m", ate.mean, note=note),
        Metric("ate_median_m", ate.median, note=note),
        Metric("ate_std_m", ate.std, note=note),
        Metric("ate_max_m", ate.max, note=note),
        Metric("ate_mse_m2", ate.rmse**2, note=f"{note}; the paper's eq. (14)"),
        Metric("ate_rotation_rmse_deg", math.degrees(turned.rmse), note=note),
        Metric("ate_rmse_unaligned_m", raw.rmse, note=raw_note),
        Metric("ate_rotation_rmse_unaligned_deg", math.degrees(raw_turned.rmse), note=raw_note),
    )


def _relative_metrics(
    pairs: Pairs, name: str, scale: float, delta: float, unit: StretchUnit
) -> tuple[Metric, ...]:
    try:
        errors = relative_errors(pairs, delta, unit, scale)
    except BadInput:
        if name == "rpe":
            raise
        return ()
    translation, rotation = errors.translation_m, errors.rotation_rad
    low, high = rms_interval(np.degrees(rotation))
    return (
        Metric(
            f"{name}_translation_rmse_m",
            statistics(translation).rmse,
            note=errors.note,
            interval=rms_interval(translation),
        ),
        Metric(
            f"{name}_rotation_rmse_deg",
            math.degrees(statistics(rotation).rmse),
            note=errors.note,
            interval=(low, high),
        ),
    )


def _drift_metrics(drifts: tuple[Drift, ...]) -> tuple[Metric, ...]:
    if not drifts:
        return ()
    off = np.concatenate([d.translation_share for d in drifts])
    turned = np.degrees(np.concatenate([d.rotation_rad_m for d in drifts]))
    lengths = ", ".join(f"{d.length_m:.3g}" for d in drifts)
    note = f"mean over {count_of(len(off), 'stretch', 'stretches')} of {lengths} m"
    return (
        Metric("drift_translation_share", float(off.mean()), note=note),
        Metric("drift_rotation_deg_per_m", float(turned.mean()), note=note),
    )


def _extent_metrics(pairs: Pairs) -> tuple[Metric, ...]:
    """Return scale and matched share."""
    reference, estimate = positions(pairs.reference), positions(pairs.estimate)
    matched = len(reference) / pairs.possible
    found = (Metric("matched_share", matched, note=pairs.note),)
    if np.ptp(estimate, axis=0).max() < 1e-6:
        return found
    note = "that would fit the estimate best"
    scale = fit(estimate, reference, scaled=True).scale
    return (*found, Metric("scale_ratio", scale, note=note))
