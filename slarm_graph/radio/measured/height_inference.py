# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bayesian inference of obstacle heights from the signal strength behind them.

An obstacle blocks the links that pass over its plan lower than its top: the length of its radio
shadow determines its height. The prior is that of the plan's class, and the loss of an obstacle is
about that of a wall. Shadowing and fading are those of the fit, so that readings near each other,
which share their shadowing, count for less than as many of different places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, STRtree, points

from slarm_graph.access_points import AccessPoint
from slarm_graph.backend import Heartbeat, silent
from slarm_graph.config import MeasuredConfig, RadioConfig
from slarm_graph.counts import count_of
from slarm_graph.geographic import CellState, GeographicMap, HeightGroup
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.height_evidence import LinkClearances, height_evidence
from slarm_graph.radio.measured.height_posterior import HeightPosterior
from slarm_graph.radio.measured.height_sampler import height_probabilities
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import RssReadings
from slarm_graph.radio.propagation.solid_crossings import lowest_link_heights

STEP_M = 0.1
"""Between discrete heights. A link from 2.4 m to 0.5 m that passes half-way over a top 0.1 m higher
or lower ends 0.3 m away in six: the side of one to two nodes."""

_UNIFORM_SHARE = 0.05
"""Share of the prior that is uniform over all heights: one in twenty, as the prior's own judgement
of what is beyond the standards' bounds."""

_MOST_OBSTACLES = 256
"""Those with the most links are inferred; bounds memory and time. The largest shipped world but one
has 66."""

_AT_ONCE = 32
"""Obstacles sampled jointly, the others at their expected effect: 1,000 columns of heights,
50 MB."""

_MOST_READINGS = 6_000
"""Of an access point: a drive of 20 minutes at five a second; of more, every second or third."""

_NODES_SIDE, _ROUNDS = 2.0, 2
"""Side of nodes over the map's, as for hyperparameters, and rounds of fitting these: the first with
the prior's heights, which shadowing then has to make up for."""

_EQUALLY_LIKELY = 200
"""Quantiles that represent a posterior: its tails to half a percent."""

_FACE_CELLS = 1.5
"""Cells so near to a face belong to it: a cell, and its diagonal."""


def infer_heights(
    geographic: GeographicMap,
    readings: Mapping[str, RssReadings],
    access_points: Sequence[AccessPoint],
    radio: RadioConfig,
    config: MeasuredConfig,
    rng: np.random.Generator,
    heartbeat: Heartbeat = silent,
) -> tuple[HeightPosterior, ...]:
    """Infer the heights of obstacles of uncertain height that any link's blocking depends on.

    Parameters
    ----------
    geographic : GeographicMap
        With the prior of heights.
    readings : mapping of access point's name to RssReadings
    access_points : sequence of AccessPoint
        Those of known position; others are not used.
    radio : RadioConfig
    config : MeasuredConfig
    rng : numpy.random.Generator
    heartbeat : Heartbeat
    """
    groups = [n for n, g in enumerate(geographic.height_groups) if np.ptp(g.levels_m) > 0.0]
    heard = _link_clearances(geographic, groups, readings, access_points, radio, config)
    if not heard:
        return ()
    tops_m = [geographic.height_groups[n].levels_m for n in groups]
    levels_m = STEP_M * np.arange(np.ceil(max(top.max() for top in tops_m) / STEP_M) + 1.0)
    priors = [level_probabilities(top[:, 0], levels_m) for top in tops_m]
    deciding = np.sum([_deciding_links(one.lowest_m, priors, levels_m) for one in heard], axis=0)
    chosen = np.flatnonzero(deciding)
    chosen = np.sort(chosen[np.argsort(-deciding[chosen], kind="stable")][:_MOST_OBSTACLES])
    found = list(priors)
    floor = _floor(geographic, config)
    for _ in range(_ROUNDS):
        heard = [one.fitted(floor, levels_m, found) for one in heard]
        for which in np.array_split(chosen, -(-len(chosen) // _AT_ONCE)) if len(chosen) else ():
            heartbeat(f"heights of {count_of(len(which), 'obstacle')} by what is heard behind them")
            evidence = [height_evidence(one, floor, levels_m, found, which) for one in heard]
            logs = [np.log(np.maximum(priors[k], 1e-300)) for k in which]
            for k, share in zip(which, height_probabilities(evidence, logs, rng), strict=True):
                found[k] = share
    return tuple(
        HeightPosterior(
            groups[k], _center_m(geographic, groups[k]), levels_m, priors[k], found[k], n
        )
        for k, n in zip(chosen.tolist(), deciding[chosen].tolist(), strict=True)
    )


def level_probabilities(equally_likely_m: Floats, levels_m: Floats) -> Floats:
    """Return the probabilities of levels (L,) from equally likely heights (K,) [m].

    Parameters
    ----------
    equally_likely_m : (K,)
        Ascending.
    levels_m : (L,)
        A step apart, from the floor.
    """
    count = len(equally_likely_m)
    middles = (np.arange(count) + 0.5) / count
    drawn = (np.arange(_EQUALLY_LIKELY) + 0.5) / _EQUALLY_LIKELY
    nearest = np.rint(np.interp(drawn, middles, equally_likely_m) / STEP_M).astype(np.int64)
    share = np.bincount(nearest, minlength=len(levels_m)) / _EQUALLY_LIKELY
    anywhere = levels_m > equally_likely_m[0] - STEP_M
    return np.asarray((1.0 - _UNIFORM_SHARE) * share + _UNIFORM_SHARE * anywhere / anywhere.sum())


def with_heights(geographic: GeographicMap, heard: Sequence[HeightPosterior]) -> GeographicMap:
    """Return the map with inferred heights: their posterior for links, its median for solids."""
    groups, solids = list(geographic.height_groups), list(geographic.solids)
    heights_m = geographic.heights_m.copy()
    owner = group_of_cells(geographic, [one.group for one in heard])
    drawn = (np.arange(_EQUALLY_LIKELY) + 0.5) / _EQUALLY_LIKELY
    for k, one in enumerate(heard):
        own, median_m = groups[one.group].solids, one.quantile_m(0.5)
        levels_m = np.array([one.quantile_m(float(share)) for share in drawn])
        groups[one.group] = HeightGroup(own, np.repeat(levels_m[:, None], len(own), axis=1))
        for number in own:
            solids[number] = replace(solids[number], height_m=median_m)
        heights_m[owner == k] = median_m
    source = f"heard behind {count_of(len(heard), 'obstacle')}, else {geographic.height_source}"
    return replace(
        geographic,
        solids=tuple(solids),
        height_groups=tuple(groups),
        heights_m=heights_m,
        height_source=source if heard else geographic.height_source,
    )


def group_of_cells(geographic: GeographicMap, groups: Sequence[int]) -> NDArray[np.int32]:
    """Return which of some groups (rows, cols) an obstacle cell belongs to; -1 for none."""
    owner = np.full(geographic.geometry.shape, -1, dtype=np.int32)
    of_solid = np.full(len(geographic.solids), -1)
    for k, n in enumerate(groups):
        of_solid[list(geographic.height_groups[n].solids)] = k
    cells = np.argwhere(geographic.states == CellState.OBSTACLE)
    faces = STRtree([Polygon(solid.corners_m) for solid in geographic.solids])
    cell, solid = faces.query_nearest(
        points(geographic.geometry.center_of(cells)),
        max_distance=_FACE_CELLS * geographic.geometry.resolution_m,
        all_matches=False,
    )
    owner[tuple(cells[cell].T)] = of_solid[solid]
    return owner


def _link_clearances(
    geographic: GeographicMap,
    groups: Sequence[int],
    readings: Mapping[str, RssReadings],
    access_points: Sequence[AccessPoint],
    radio: RadioConfig,
    config: MeasuredConfig,
) -> list[LinkClearances]:
    """Return the readings of every known access point, and the clearance of their links."""
    if not groups:
        return []
    certain = np.where(group_of_cells(geographic, groups) < 0, geographic.heights_m, 0.0)
    certain_map = replace(geographic, heights_m=certain.astype(np.float32))
    found = []
    for ap in access_points:
        own = readings.get(ap.name)
        if own is None or own.heard.sum() < config.least_readings:
            continue
        heard = np.flatnonzero(own.heard)
        own = own.only(heard[:: -(-len(heard) // _MOST_READINGS)])
        mean = MeanFunction(certain_map, ap, radio.antenna_height_m, radio.mount_radius_m)
        lowest_m = [_lowest_over(geographic, n, ap, own, radio) for n in groups]
        found.append(LinkClearances(own, mean, np.stack(lowest_m)))
    return found


def _lowest_over(
    geographic: GeographicMap, group: int, ap: AccessPoint, own: RssReadings, radio: RadioConfig
) -> Floats:
    """Lowest heights (N,) of links over the plans of a group [m]."""
    return lowest_link_heights(
        [geographic.solids[n] for n in geographic.height_groups[group].solids],
        ap.position_m(),
        own.points_m,
        radio.antenna_height_m,
        mount_radius_m=radio.mount_radius_m,
    )


def _deciding_links(
    lowest_m: Floats, priors: Sequence[Floats], levels_m: Floats
) -> NDArray[np.int64]:
    """Number (G,) of links that each obstacle blocks at some of its heights only."""
    ends = [levels_m[np.flatnonzero(prior)[[0, -1]]] for prior in priors]
    low_m, top_m = np.array(ends).T[:, :, None]
    return np.asarray(((low_m <= lowest_m) & (lowest_m < top_m)).sum(axis=1))


def _floor(geographic: GeographicMap, config: MeasuredConfig) -> FloorField:
    side_m = _NODES_SIDE * config.node_side_m
    return FloorField(make_nodes(geographic.geometry, geographic.free, side_m, config.search_nodes))


def _center_m(geographic: GeographicMap, group: int) -> Floats:
    """Centre (2,) of the bounding box of a group's plans [m]."""
    own = geographic.height_groups[group].solids
    corners = np.concatenate([geographic.solids[n].corners_m for n in own])
    return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
