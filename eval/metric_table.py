# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of metrics: every figure the toolkit reports, in the order in which it is shown.

Packages add theirs with an entry point of the group `slarm_graph.metrics`; see `MetricPart`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Final

from slarm_graph.eval.metrics import Metric, MetricKind

_TRUTH = "with a true trajectory"
_RELATIONS = "with true relative poses"
_WORLD = "in a known world"
_DRIVEN = "where a robot explores"
_MAP = "with a true map"
_ALWAYS = "always"
_RUN = "of a run"
_LEVELS = "of two radio maps"
_K = MetricKind

_BUILT_IN: Final = (
    # --- radio map against the truth
    _K("accuracy", "", "radio-map accuracy", "more", _WORLD, "share of the truly accessible area"
       " that is recovered as accessible and whose gain is within the tolerance", True),
    _K("accuracy_worst_ap", "", "radio-map accuracy, worst access point", "more", _WORLD, "the"
       " accuracy above is the mean over all access points"),
    _K("accuracy_with_sizes", "", "radio-map accuracy, all sizes known", "more", _DRIVEN, "of the"
       " same drive, the length, width and height of every obstacle being known"),
    _K("accuracy_without_sizes", "", "radio-map accuracy, no size known", "more", _DRIVEN, "of the"
       " same drive, heights taken from a prior"),
    *(
        _K(f"accuracy_re_{key}_{sizes}_sizes", "", f"accuracy, R_e = {words}, {sizes} sizes",
           "more", _DRIVEN, "of the same drive, with explore.judge_variants")
        for key, words in (("cell", "one cell"), ("robot", "robot radius"), ("zero", "0"))
        for sizes in ("with", "without")
    ),
    _K("accuracy_area", "", "radio-map accuracy on a fine lattice", "more", _WORLD, "the same on a"
       " lattice that does not depend on the run's resolution"),
    _K("coverage_observed", "", "observed", "more", _WORLD, "share of the accessible area seen"),
    _K("coverage_visited", "", "visited", "more", _WORLD, "share of the accessible area whose cells"
       " the robot's centre entered"),
    _K("coverage_footprint", "", "covered by the body", "more", _WORLD, "share of the accessible"
       " area the robot's body passed over"),
    _K("gain_hit", "", "gain within tolerance", "more", _WORLD, "share of the area accessible in"
       " both whose gain is within the tolerance"),
    _K("coverage_accessible", "", "accessible area found", "more", _WORLD, "share of the truly"
       " accessible area that is recovered as such"),
    _K("los_agreement", "", "line of sight agrees", "more", _WORLD, "share of the area accessible"
       " in both whose line of sight is of one class in both: clear, blocked or unknown"),
    _K("los_unknown", "", "line of sight unknown", "less", _WORLD, "share of the area accessible in"
       " both whose link passes cells nobody has seen"),
    _K("los_brier", "", "line of sight, Brier score", "less", _WORLD, "mean square of the"
       " probability of line of sight less the truth, 0 or 1"),
    _K("false_accessible", "", "falsely accessible", "less", _WORLD, "share of the cells called"
       " accessible that are not"),
    _K("iou", "", "accessible area, IoU", "more", _WORLD, "intersection over union"),
    _K("gain_rmse_db", "dB", "gain error, RMSE", "less", _WORLD, "over the gains in both"),
    _K("gain_mae_db", "dB", "gain error, mean", "less", _WORLD, "mean absolute difference"),
    # --- levels of two radio maps
    _K("levels_rmse_db", "dB", "levels, RMSE", "less", _LEVELS, "root mean square of estimate less"
       " reference, over cells with a level in both and their common access points", True),
    _K("levels_bias_db", "dB", "levels, mean difference", "", _LEVELS, "mean of the same"),
    _K("levels_mae_db", "dB", "levels, mean error", "less", _LEVELS, "mean absolute difference"),
    _K("levels_differ", "", "levels surely differ", "", _LEVELS, "share of those cells whose"
       " difference is above 1.96 standard deviations, by what both maps say of themselves"),
    _K("levels_area_m2", "m^2", "levels, area compared", "", _LEVELS, "cells with a level in both"),
    # --- the drive
    _K("path_length_m", "m", "path length", "", _ALWAYS, "sum over the steps of the estimate, or as"
       " truly driven in a world"),
    _K("turns", "", "turns", "less", _DRIVEN, "of 45 degrees and more"),
    _K("revisit_share", "", "cells entered again", "less", _DRIVEN, "share of cell entries"),
    _K("drive_time_s", "s", "driving time", "less", _DRIVEN, "simulated"),
    _K("collisions", "", "collisions", "less", _DRIVEN, "contacts with the true world"),
    _K("planning_s", "s", "planning", "less", _DRIVEN, "processor time of the explorer"),
    # --- trajectory against the truth
    _K("ate_rmse_m", "m", "ATE, RMSE", "less", _TRUTH, "root mean square distance of matched"
       " positions after alignment", True),
    _K("ate_mean_m", "m", "ATE, mean", "less", _TRUTH, "mean of the same distances"),
    _K("ate_median_m", "m", "ATE, median", "less", _TRUTH, "median of them"),
    _K("ate_std_m", "m", "ATE, standard deviation", "less", _TRUTH, "of the population"),
    _K("ate_max_m", "m", "ATE, largest", "less", _TRUTH, "the largest of them"),
    _K("ate_mse_m2", "m^2", "ATE, mean square", "less", _TRUTH, "the paper's eq. (14)"),
    _K("ate_rmse_unaligned_m", "m", "ATE, RMSE, not aligned", "less", _TRUTH, "as it stands"),
    _K("ate_rotation_rmse_deg", "deg", "ATE, rotation, RMSE", "less", _TRUTH, "root mean square"
       " angle between matched orientations after alignment"),
    _K("ate_rotation_rmse_unaligned_deg", "deg", "ATE, rotation, RMSE, not aligned", "less",
       _TRUTH, "as it stands"),
    _K("rpe_translation_rmse_m", "m", "RPE, translation", "less", _TRUTH, "root mean square error"
       " of relative motions over consecutive stretches (Sturm et al. 2012), a frame unless said"),
    _K("rpe_rotation_rmse_deg", "deg", "RPE, rotation", "less", _TRUTH, "of the same stretches"),
    _K("rpe_metre_translation_rmse_m", "m", "RPE over a metre, translation", "less", _TRUTH,
       "the same over stretches of a metre"),
    _K("rpe_metre_rotation_rmse_deg", "deg", "RPE over a metre, rotation", "less", _TRUTH,
       "of the same stretches"),
    _K("rpe_second_translation_rmse_m", "m", "RPE over a second, translation", "less", _TRUTH,
       "the same over stretches of a second"),
    _K("rpe_second_rotation_rmse_deg", "deg", "RPE over a second, rotation", "less", _TRUTH,
       "of the same stretches"),
    _K("drift_translation_share", "", "drift, translation", "less", _TRUTH, "mean error of relative"
       " positions over the distance between (Geiger et al. 2012)"),
    _K("drift_rotation_deg_per_m", "deg/m", "drift, rotation", "less", _TRUTH, "mean error of"
       " relative angles over the distance between"),
    _K("scale_ratio", "", "scale", "", _TRUTH, "by which the estimate would fit best"),
    _K("matched_share", "", "poses matched", "more", _TRUTH, "share of the sparser trajectory's"),
    # --- true relations
    _K("relations_translation_m", "m", "relations, translation", "less", _RELATIONS, "mean error"
       " over true relative poses (Kuemmerle et al. 2009)", True),
    _K("relations_translation_sd_m", "m", "relations, translation, standard deviation", "less",
       _RELATIONS, "of the same errors"),
    _K("relations_rotation_deg", "deg", "relations, rotation", "less", _RELATIONS, "mean error",
       True),
    _K("relations_rotation_sd_deg", "deg", "relations, rotation, standard deviation", "less",
       _RELATIONS, "of the same errors"),
    _K("relations_used", "", "relations used", "more", _RELATIONS, "within the trajectory's time"),
    _K("relations_total", "", "relations in the file", "", _RELATIONS, "all"),
    # --- without truth
    _K("map_conflict_share", "", "map contradicts itself", "less", _ALWAYS, "share of the wall"
       " cells seen by two visits that one of them looks through, over all pairs of visits", True),
    _K("cross_checked_share", "", "seen again", "more", _ALWAYS, "share of the way whose walls were"
       " seen again when the robot had come back"),
    _K("map_entropy_nat", "nat", "map entropy", "less", _ALWAYS, "mean over neighbourhoods of end"
       " points of 0.5 ln |2 pi e C| (Droeschel and Behnke 2018)", True),
    _K("wall_sigma_m", "m", "wall thickness, sigma", "less", _ALWAYS, "median spread of end points"
       " across walls", True),
    _K("wall_sigma_95_m", "m", "wall thickness, sigma, 95 %", "less", _ALWAYS, "95th percentile of"
       " it, where doubled walls show first"),
    # --- occupancy map against a true one
    _K("map_cell_accuracy", "", "cells right", "more", _MAP, "share of cells known in both"),
    _K("map_iou", "", "walls, IoU", "more", _MAP, "intersection over union of occupied cells"),
    _K("map_iou_free", "", "free space, IoU", "more", _MAP, "of free cells"),
    _K("map_precision", "", "walls, precision", "more", _MAP, "found walls that are there"),
    _K("map_recall", "", "walls, recall", "more", _MAP, "true walls that are found"),
    _K("map_f1", "", "walls, F1", "more", _MAP, "harmonic mean of both"),
    _K("map_known_share", "", "known of the reference", "more", _MAP, "share of its known cells"),
    _K("wall_distance_mean_m", "m", "wall distance, mean", "less", _MAP, "from found walls to the"
       " nearest true one"),
    _K("wall_distance_95_m", "m", "wall distance, 95 %", "less", _MAP, "95th percentile of it"),
    # --- cost
    _K("wall_s", "s", "wall time", "less", _RUN, "from start to report", True),
    _K("cpu_s", "s", "processor time", "less", _RUN, "of all threads"),
    _K("scans_per_s", "1/s", "scans per second", "more", _RUN, "over the time from the first"
       " reading to the final map", True),
    _K("peak_memory_mb", "MB", "peak memory", "less", _RUN, "resident set", True),
)  # fmt: skip

_SUFFIXES: Final = ("m", "deg", "s", "db", "nat", "mb")


@cache
def kinds() -> Mapping[str, MetricKind]:
    """Return all kinds of metrics by name, those of plug-ins last."""
    from slarm_graph.eval.metric_parts import parts

    added = {kind.name: kind for part in parts() for kind in part.kinds}
    built_in = {kind.name: kind for kind in _BUILT_IN}
    return built_in | {name: kind for name, kind in added.items() if name not in built_in}


def kind_of(name: str) -> MetricKind:
    """Return the kind of a metric; of an unknown one, what its name says."""
    known = kinds().get(name)
    if known is not None:
        return known
    stem, _, suffix = name.rpartition("_")
    has_unit = suffix in _SUFFIXES
    title = (stem if has_unit else name).replace("_", " ")
    return MetricKind(name, suffix if has_unit else "", title, "", _ALWAYS, "")


def headlines() -> tuple[MetricKind, ...]:
    """Return the kinds that short tables show, in their order."""
    return tuple(kind for kind in kinds().values() if kind.headline)


def in_table_order(metrics: Iterable[Metric]) -> tuple[Metric, ...]:
    """Sort metrics as the table has them; of those with one name the first stays."""
    first: dict[str, Metric] = {}
    for metric in metrics:
        first.setdefault(metric.name, metric)
    places = {name: index for index, name in enumerate(kinds())}
    return tuple(sorted(first.values(), key=lambda m: places.get(m.name, len(places))))
