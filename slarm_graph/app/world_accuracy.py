# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of recovered maps and radio maps against the true world."""

from __future__ import annotations

from slarm_graph.access_points import RadioMap
from slarm_graph.config import RadioConfig, RecoveryConfig, RunConfig
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.radio_accuracy import Extent, radio_accuracy
from slarm_graph.eval.radio_scores import RadioAccuracy
from slarm_graph.geographic import GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.radio_map import radio_map, theoretical_radio_map
from slarm_graph.recovery.fine_map import FineMap
from slarm_graph.recovery.recover import recover_fine, with_sizes_of
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

FINE_M = 0.02
"""Cell size of `accuracy_area`, at which maps of different resolutions are compared."""


def accuracy_metrics(
    world: WorldMap,
    geographic: GeographicMap,
    radio: RadioMap,
    config: RadioConfig,
    area: Extent | None = None,
) -> tuple[Metric, ...]:
    """Compare recovered maps with the truth: at their own resolution, and at `FINE_M`."""
    same = accuracy_on(world, geographic, radio, config, geographic.geometry.resolution_m, area)
    fine = accuracy_on(world, geographic, radio, config, FINE_M, area)
    on_fine = Metric("accuracy_area", fine.accuracy, note=f"on a lattice of {FINE_M:g} m")
    return (*same.metrics(), on_fine)


def sizes_metrics(
    world: WorldMap, drawn: FineMap, trajectory: Trajectory, config: RunConfig
) -> tuple[Metric, Metric]:
    """Return the accuracy of a drive's maps recovered with all obstacle sizes known, and none."""
    with_sizes, without = (
        _recovered_accuracy(world, drawn, trajectory, config, recovery)
        for recovery in _with_and_without_sizes(world, config.recovery)
    )
    heights = f"line of sight: Brier score {without.los_brier:.4f}"
    return (
        Metric("accuracy_with_sizes", with_sizes.accuracy),
        Metric("accuracy_without_sizes", without.accuracy, note=heights),
    )


def variant_metrics(
    world: WorldMap, drawn: FineMap, trajectory: Trajectory, config: RunConfig
) -> tuple[Metric, ...]:
    """Return the accuracy of a drive for every R_e of the figures, with and without sizes."""
    radii_m = {
        "cell": config.explore.resolution_m,
        "robot": config.explore.driving.robot_radius_m,
        "zero": 0.0,
    }
    found = []
    for key, radius_m in radii_m.items():
        both = _with_and_without_sizes(world, config.recovery)
        for sizes, recovery in zip(("with", "without"), both, strict=True):
            expanded = recovery.model_copy(update={"expansion_radius_m": radius_m})
            score = _recovered_accuracy(world, drawn, trajectory, config, expanded)
            name = f"accuracy_re_{key}_{sizes}_sizes"
            found.append(Metric(name, score.accuracy, note=f"R_e = {score.expansion_radius_m:g} m"))
    return tuple(found)


def _with_and_without_sizes(
    world: WorldMap, recovery: RecoveryConfig
) -> tuple[RecoveryConfig, RecoveryConfig]:
    """Return the settings of recovery with all sizes known and with none."""
    return with_sizes_of(world, recovery), recovery.model_copy(update={"known_sizes": ()})


def _recovered_accuracy(
    world: WorldMap,
    drawn: FineMap,
    trajectory: Trajectory,
    config: RunConfig,
    recovery: RecoveryConfig,
) -> RadioAccuracy:
    """Return the accuracy of a drive's maps recovered with other settings."""
    resolution_m = config.explore.resolution_m
    geometry = GridGeometry.covering(*world.extent_m(), resolution_m)
    geographic = recover_fine(drawn, trajectory, recovery, geometry)
    radio = radio_map(geographic, world.access_points, config.radio)
    return accuracy_on(world, geographic, radio, config.radio, resolution_m, config.explore.area)


def accuracy_on(
    world: WorldMap,
    geographic: GeographicMap,
    radio: RadioMap,
    config: RadioConfig,
    resolution_m: float,
    area: Extent | None = None,
) -> RadioAccuracy:
    """Compare recovered maps with the truth at a given resolution.

    Only cells in the area count that the robot was not to leave, if there is one.
    """
    truth = truth_map(world, resolution_m, area=area)
    return radio_accuracy(
        truth.reachable,
        theoretical_radio_map(world, truth.geometry, config),
        geographic,
        radio,
        tolerance_db=config.gain_tolerance_db,
        extent_m=_common(world.extent_m(), area),
    )


def _common(extent: Extent, area: Extent | None) -> Extent:
    """Return the intersection of two rectangles."""
    if area is None:
        return extent
    return (
        max(extent[0], area[0]),
        min(extent[1], area[1]),
        max(extent[2], area[2]),
        min(extent[3], area[3]),
    )
