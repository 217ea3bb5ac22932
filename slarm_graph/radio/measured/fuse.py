# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From readings along a trajectory to the measured radio map: model + field between walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint
from slarm_graph.backend import Heartbeat, silent
from slarm_graph.config import MeasuredConfig, RadioConfig
from slarm_graph.cores import usable_cores
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.radio.measured.blocks import blocks_of
from slarm_graph.radio.measured.fit import Fit, Hyperparameters, Problem, fit_field
from slarm_graph.radio.measured.locate import locate
from slarm_graph.radio.measured.mean import Mean
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.nodes import Nodes, make_nodes
from slarm_graph.radio.measured.predict import FittedAccessPoint, Mapped, mapped
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import Placed, Receiver

_PIECE_S = 60.0
"""Readings for the search are taken a minute at a time, long against any drift."""

_CLEARLY_ABOVE_DB = 15.0
"""So far above the threshold, silence is a lost packet: three to four sigmas of fading."""

_SEARCH_SIDES = 2.0
"""Hyperparameters are searched on pieces of floor so many times as wide: 0.4 m is still well below
any range of shadowing, and a search is many times faster."""

_MOST_AT_ONCE = 4
"""Access points that are fitted at a time, on as many cores: over 10^6 cells each takes 0.17 GB.
Six took 43 s and 0.81 GB one by one, 28 s and 0.98 GB two at a time."""


def floor_of(geographic: GeographicMap) -> Mask:
    """Cells (rows, cols) over which a field lives: all that is free."""
    states = (CellState.ACCESSIBLE, CellState.EXPANSION, CellState.ENCLOSED)
    return np.isin(geographic.states, states)


def fuse(
    geographic: GeographicMap,
    readings: Mapping[str, Placed],
    access_points: Sequence[AccessPoint],
    radio: RadioConfig,
    config: MeasuredConfig,
    heartbeat: Heartbeat = silent,
) -> MeasuredMap:
    """Make the measured radio map.

    Parameters
    ----------
    geographic : GeographicMap
    readings : mapping of access point's name to Placed
    access_points : sequence of AccessPoint
        Those whose position is known, by name.
    radio : RadioConfig
    config : MeasuredConfig
    heartbeat : Heartbeat

    Raises
    ------
    BadInput
        When no access point was heard often enough.
    """
    known = {ap.name: ap for ap in access_points}
    floor = floor_of(geographic)
    nodes = make_nodes(geographic.geometry, floor, config.node_side_m, config.most_nodes)
    side_m = _SEARCH_SIDES * config.node_side_m
    coarse = make_nodes(geographic.geometry, floor, side_m, config.search_nodes)
    blocks, done, notices = blocks_of(geographic), [], []
    often, heard = [], {name: int(placed.heard.sum()) for name, placed in readings.items()}
    for name, count in heard.items():
        if count >= config.least_readings:
            often.append(name)
            continue
        notices.append(
            f"{name} was heard {count_of(count, 'time')}; {config.least_readings} make a map"
        )

    cells = np.argwhere(geographic.accessible | (geographic.states == CellState.EXPANSION))

    def done_one(name: str) -> Mapped:
        """One access point's, on floors of its own: what they keep of ranges is not shared."""
        mean = Mean(
            geographic, known.get(name), radio.antenna_height_m, radio.mount_radius_m, blocks
        )
        floors = FloorField(nodes), FloorField(coarse)
        one = _fused_one(floors, mean, readings[name], name, radio, config)
        return mapped(nodes, one, cells, name, radio)

    heartbeat(f"measured maps of {count_of(len(often), 'access point')}")
    with ThreadPoolExecutor(min(usable_cores(), _MOST_AT_ONCE)) as pool:
        for name, one in zip(often, pool.map(done_one, often), strict=True):
            heartbeat(f"measured map of {name}, {count_of(len(readings[name]), 'reading')}")
            done.append(one)
    if not done:
        raise BadInput("; ".join(notices) or "no reading of signal strength lies on the way")
    return _together(geographic, cells, done, radio, tuple(notices))


def _fused_one(
    floors: tuple[FloorField, FloorField],
    mean: Mean,
    placed: Placed,
    name: str,
    radio: RadioConfig,
    config: MeasuredConfig,
) -> FittedAccessPoint:
    """Fit one access point, located by what was heard of it where nobody told its position."""
    if mean.access_point is not None or not config.locate:
        return fit_access_point(floors, mean, placed, config)
    found = locate(floors[1], mean, placed, config)
    x, y, z = (float(v) for v in found.position_m)
    point = AccessPoint(name, x, y, z, radio.power_dbm, radio.frequency_hz)
    mean = replace(mean, access_point=point)
    fitted = fit_access_point(floors, mean, placed, config, found.hyper)
    return replace(fitted, position_sd_m=found.sd_m())


def fit_access_point(
    floors: tuple[FloorField, FloorField],
    mean: Mean,
    placed: Placed,
    config: MeasuredConfig,
    hyper: Hyperparameters | None = None,
) -> FittedAccessPoint:
    """Search one access point's hyperparameters on part of the readings, and fit all of them.

    Parameters
    ----------
    floors : (FloorField, FloorField)
        To fit on, and a coarser one to search on.
    mean : Mean
    placed : Placed
    config : MeasuredConfig
    hyper : Hyperparameters, optional
        Known already, such as from locating it.
    """
    fine, coarse = floors
    heard = placed.only(placed.heard)
    if hyper is None:
        part = heard.only(_pieces(heard.times_s, config.search_readings))
        # What single blocks take is a column each: four times the search's time, for the same.
        alike = replace(mean, blocks=None)
        hyper = fit_field(_problem(coarse, alike, part, Receiver())).hyper
    if placed.heard.all() and config.saturation_dbm is None:
        return FittedAccessPoint(mean, placed, _fitted(fine, mean, placed, Receiver(), hyper))
    first = _fitted(fine, mean, heard, Receiver(), hyper)
    receiver = _receiver(first, fine.nodes, mean, placed, config)
    return FittedAccessPoint(mean, placed, _fitted(fine, mean, placed, receiver, hyper))


def _problem(floor: FloorField, mean: Mean, placed: Placed, receiver: Receiver) -> Problem:
    design, doubt_db2 = mean.of_readings_with_doubt(placed)
    slope = mean.slope_db_m(placed.points_m)
    doubt_db2 *= floor.nodes.shared(placed.points_m)
    return Problem(floor, placed, design, mean.coefficients(placed), slope, receiver, doubt_db2)


def _fitted(
    floor: FloorField, mean: Mean, placed: Placed, receiver: Receiver, hyper: Hyperparameters
) -> Fit:
    return fit_field(_problem(floor, mean, placed, receiver), hyper, search=False)


def _pieces(times_s: Floats, most: int) -> NDArray[np.int64]:
    """Indices of readings in whole minutes spread over the time, about as many as wished."""
    if len(times_s) <= most:
        return np.arange(len(times_s))
    minute = np.floor((times_s - times_s.min()) / _PIECE_S).astype(np.int64)
    minutes = np.unique(minute)
    keep = max(1, round(len(minutes) * most / len(times_s)))
    chosen = minutes[np.linspace(0, len(minutes) - 1, keep).round().astype(np.int64)]
    taken = np.flatnonzero(np.isin(minute, chosen))
    return taken[:: max(1, len(taken) // most)]


def _receiver(
    fit: Fit, nodes: Nodes, mean: Mean, placed: Placed, config: MeasuredConfig
) -> Receiver:
    """What the receiver cannot tell: its threshold, and how often a strong packet is lost."""
    weakest = float(np.nanmin(placed.rss_dbm))
    threshold = weakest if config.threshold_dbm is None else config.threshold_dbm
    level = mean.of_map(placed.points_m) @ fit.posterior.beta[: mean.terms]
    level += nodes.weights(placed.points_m) @ fit.posterior.state[: len(nodes)]
    strong = level > threshold + _CLEARLY_ABOVE_DB
    lost = float((~placed.heard[strong]).mean()) if strong.any() else 0.0
    most = np.inf if config.saturation_dbm is None else config.saturation_dbm
    return Receiver(threshold, most, float(np.clip(lost, 1e-3, 0.99)))


def _together(
    geographic: GeographicMap,
    cells: NDArray[np.int64],
    done: Sequence[Mapped],
    radio: RadioConfig,
    notices: tuple[str, ...],
) -> MeasuredMap:
    """Put what was predicted of cells (N, 2) on one map."""
    shape = (len(done), *geographic.geometry.shape)
    layers = [np.full(shape, np.nan, dtype=np.float32) for _ in range(3)]
    for index, one in enumerate(done):
        for layer, values in zip(layers, one.levels, strict=True):
            layer[index][tuple(cells.T)] = values
    return MeasuredMap(
        geographic.geometry,
        tuple(one.access_point for one in done),
        mean_dbm=layers[0],
        mean_sd_db=layers[1],
        reading_sd_db=layers[2],
        fitted=tuple(one.terms for one in done),
        antenna_height_m=radio.antenna_height_m,
        notices=notices,
    )
