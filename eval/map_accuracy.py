# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of an occupancy grid against a reference grid, unknown cells kept apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.errors import BadInput
from slarm_graph.eval.metrics import Metric
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import Mask, OccupancyGrid
from slarm_graph.raster.distance import distance_to

_MEANINGFUL_OVERLAP = 0.3
"""Least known share of a meaningful comparison: below 30 % only what was easy to see is compared.
It only adds a remark to the metrics."""


@dataclass(frozen=True, slots=True)
class MapAccuracy:
    """Accuracy of an occupancy grid against a reference, on the reference's cells.

    Parameters
    ----------
    cell_accuracy : float
        Share of the cells known in both that have the same class.
    iou, iou_free : float
        Intersection over union of occupied and of free cells.
    precision, recall, f1 : float
        Of occupied cells, which match within the tolerance.
    wall_distance_mean_m, wall_distance_95_m : float
        From the estimate's occupied cells to the nearest occupied cell of the reference [m].
    known_share : float
        Share of the reference's known cells that the estimate knows too.
    tolerance_m : float
    resampled : bool
        Whether the estimate has another resolution or origin.
    """

    cell_accuracy: float
    iou: float
    iou_free: float
    precision: float
    recall: float
    f1: float
    wall_distance_mean_m: float
    wall_distance_95_m: float
    known_share: float
    tolerance_m: float
    resampled: bool

    @property
    def meaningful(self) -> bool:
        """Whether enough of the reference was mapped for the metrics to be meaningful."""
        return self.known_share >= _MEANINGFUL_OVERLAP


def map_accuracy(
    reference: OccupancyGrid,
    estimate: OccupancyGrid,
    *,
    reference_from_estimate: Pose2 | None = None,
    tolerance_m: float = 0.1,
) -> MapAccuracy:
    """Compare two occupancy grids.

    Parameters
    ----------
    reference, estimate : OccupancyGrid
    reference_from_estimate : Pose2, optional
        Rigid motion of the estimate [m, m, rad]; identity when left out.
    tolerance_m : float
        Distance within which an occupied cell counts as found [m].

    Raises
    ------
    BadInput
        When the reference has no occupied cell.
    """
    if not reference.occupied.any():
        raise BadInput("the reference map has no occupied cell; is `negate` right in its yaml?")
    occupied, free = classes_on(reference, estimate, reference_from_estimate or Pose2())
    ref_known, est_known = ~reference.unknown, occupied | free
    both = ref_known & est_known
    resolution_m = reference.geometry.resolution_m
    to_reference = distance_to_m(reference.occupied, resolution_m)[occupied & ref_known]
    to_estimate = distance_to_m(occupied, resolution_m)[reference.occupied & est_known]
    precision, recall = _share(to_reference <= tolerance_m), _share(to_estimate <= tolerance_m)
    return MapAccuracy(
        cell_accuracy=_share((occupied == reference.occupied)[both]),
        iou=_iou(occupied & ref_known, reference.occupied & est_known),
        iou_free=_iou(free & ref_known, reference.free & est_known),
        precision=precision,
        recall=recall,
        f1=2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0,
        wall_distance_mean_m=float(to_reference.mean()) if len(to_reference) else float("nan"),
        wall_distance_95_m=float(np.percentile(to_reference, 95))
        if len(to_reference)
        else float("nan"),
        known_share=_share(est_known[ref_known]),
        tolerance_m=tolerance_m,
        resampled=reference.geometry != estimate.geometry,
    )


def classes_on(
    reference: OccupancyGrid, estimate: OccupancyGrid, reference_from_estimate: Pose2
) -> tuple[Mask, Mask]:
    """Sample the estimate's occupied and free cells at the centres of the reference's cells."""
    centers = reference_from_estimate.inverse().transform(reference.geometry.centers())
    lookup = estimate.geometry.sample
    return lookup(estimate.occupied, centers, False), lookup(estimate.free, centers, False)


def distance_to_m(mask: Mask, resolution_m: float) -> Floats:
    """Distance (rows, cols) [m] from every cell's centre to the nearest cell of the mask."""
    return distance_to(mask).astype(np.float64) * resolution_m


def map_metrics(result: MapAccuracy) -> tuple[Metric, ...]:
    """Return the accuracy as metrics."""
    note = f"tolerance {result.tolerance_m:g} m"
    if result.resampled:
        note += ", resampled to the reference's cells"
    if not result.meaningful:
        note += f", not meaningful: only {result.known_share:.0%} of the reference was mapped"
    shares = ("cell_accuracy", "iou", "iou_free", "precision", "recall", "f1", "known_share")
    lengths = ("wall_distance_mean_m", "wall_distance_95_m")
    return (
        *(Metric(f"map_{name}", getattr(result, name), note=note) for name in shares),
        *(Metric(name, getattr(result, name), note=note) for name in lengths),
    )


def _share(flags: Mask) -> float:
    return float(flags.mean()) if flags.size else 0.0


def _iou(a: Mask, b: Mask) -> float:
    union = int((a | b).sum())
    return float((a & b).sum() / union) if union else 0.0
