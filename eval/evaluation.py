# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a trajectory against a reference: frames, clock offset, alignment, metrics."""

from __future__ import annotations

from dataclasses import dataclass

from slarm_graph.eval.alignment import Alignment, AlignmentMethod, align
from slarm_graph.eval.association import AssociationMethod, Pairs, associate, by_index
from slarm_graph.eval.clocks import find_offset, offset_advice
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.plane_of_motion import planes_of, projected
from slarm_graph.eval.trajectory_accuracy import StretchUnit, aligned_rmse_m
from slarm_graph.eval.trajectory_metrics import trajectory_metrics
from slarm_graph.spatial import SpatialTrajectory
from slarm_graph.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class EvaluationOptions:
    """Options of an evaluation.

    Parameters
    ----------
    alignment : AlignmentMethod
    first : int, optional
        Align with that many pairs from the beginning only.
    association : AssociationMethod
    max_difference_s : float
        Largest difference of stamps with `nearest` [s].
    offset_s : float, optional
        Added to the estimate's stamps [s]; None: estimated.
    delta : float
        Length of the RPE's stretches, in `unit`.
    unit : {"frames", "m", "s"}
    lengths_m : tuple of float
        Path lengths over which drift is measured; empty: shares of the path.
    """

    alignment: AlignmentMethod = AlignmentMethod.SE2
    first: int | None = None
    association: AssociationMethod = AssociationMethod.INTERPOLATE
    max_difference_s: float = 0.01
    offset_s: float | None = 0.0
    delta: float = 1.0
    unit: StretchUnit = "frames"
    lengths_m: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The result of an evaluation.

    Parameters
    ----------
    pairs : Pairs
        In the plane or in space, as the alignment needs them.
    alignment : Alignment
    metrics : tuple of Metric
    notices : tuple of str
        Limitations of the metrics, and choices that were made automatically.
    """

    pairs: Pairs
    alignment: Alignment
    metrics: tuple[Metric, ...]
    notices: tuple[str, ...]


def evaluate(
    reference: SpatialTrajectory, estimate: SpatialTrajectory, options: EvaluationOptions
) -> Evaluation:
    """Evaluate an estimate against a reference.

    Raises
    ------
    BadInput
        When they have no poses in common.
    """
    timed = reference.timed and estimate.timed
    estimate = by_index(reference, estimate)
    ours, theirs, plane = _in_plane(reference, estimate)
    notices = [plane] if plane and not options.alignment.in_space else []
    offset_s = options.offset_s if timed else 0.0
    if offset_s is None:
        offset_s = find_offset(ours, theirs).offset_s
        notices.append(f"clock offset found: {offset_s:.4f} s added to the stamps of the estimate")
    flat = _associated(ours, theirs, options, offset_s)
    pairs = (
        _associated(reference, estimate, options, offset_s) if options.alignment.in_space else flat
    )
    advice = (
        offset_advice(ours, theirs, flat, offset_s)
        if timed and options.offset_s is not None
        else ""
    )
    notices += [text for text in (pairs.warning, advice) if text]
    alignment = align(pairs, options.alignment, options.first)
    metrics = trajectory_metrics(
        pairs, options.alignment, options.first, options.delta, options.unit, options.lengths_m
    )
    return Evaluation(pairs, alignment, metrics, tuple(notices))


def _associated(
    reference: Trajectory | SpatialTrajectory,
    estimate: Trajectory | SpatialTrajectory,
    options: EvaluationOptions,
    offset_s: float,
) -> Pairs:
    return associate(
        reference,  # type: ignore[type-var]
        estimate,
        method=options.association,
        max_difference_s=options.max_difference_s,
        offset_s=offset_s,
    )


def _in_plane(
    reference: SpatialTrajectory, estimate: SpatialTrajectory
) -> tuple[Trajectory, Trajectory, str]:
    """Project two paths into their planes of motion; notices name planes other than x-y."""
    plane, own = planes_of(reference, estimate)
    ours, theirs = projected(reference, plane), projected(estimate, own)
    if own is plane:
        return ours, theirs, "" if plane.is_xy else f"plane of motion: {plane.name}"
    # Of another frame it is unknown which side is up: one of the two fits, its mirror does not.
    theirs = min((theirs, projected(estimate, own.flipped())), key=lambda path: _misfit(ours, path))
    return ours, theirs, f"plane of motion: {plane.name} in REF, {own.name} in EST"


def _misfit(reference: Trajectory, estimate: Trajectory) -> float:
    offset_s = float(reference.stamps_ns[0] - estimate.stamps_ns[0]) * 1e-9
    overlapping = estimate.stamps_ns[0] < reference.stamps_ns[-1] and (
        estimate.stamps_ns[-1] > reference.stamps_ns[0]
    )
    pairs = associate(reference, estimate, offset_s=0.0 if overlapping else offset_s)
    return aligned_rmse_m(pairs)
