# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Fit the measured radio map: per access point a propagation model and a residual field."""

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
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.blocks import find_blocks
from slarm_graph.radio.measured.fit import Fit, Hyperparameters, Problem, fit_field
from slarm_graph.radio.measured.locate import locate
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.nodes import Nodes, make_nodes
from slarm_graph.radio.measured.predict import (
    FittedAccessPoint,
    PredictedAccessPoint,
    predict_access_point,
)
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import Receiver, RssReadings

_CHUNK_S = 60.0
"""Readings for the hyperparameters are taken in chunks of a minute, long against any drift."""

_CLEARLY_ABOVE_DB = 15.0
"""So far above the threshold a missing reading is a lost packet: three to four sigmas of fading."""

_SEARCH_SIDES = 2.0
"""Hyperparameters are fitted on nodes so many times as wide: 0.4 m is still well below any range of
shadowing, and the fit is many times faster."""

_MOST_AT_ONCE = 4
"""Access points that are fitted at a time, on as many cores: over 10^6 cells each takes 0.17 GB.
Six took 43 s and 0.81 GB one by one, 28 s and 0.98 GB two at a time."""


def build_measured_map(
    geographic: GeographicMap,
    readings: Mapping[str, RssReadings],
    access_points: Sequence[AccessPoint],
    radio: RadioConfig,
    config: MeasuredConfig,
    heartbeat: Heartbeat = silent,
) -> MeasuredMap:
    """Fit every access point that was heard often enough, and predict its cells.

    Parameters
    ----------
    geographic : GeographicMap
    readings : mapping of access point's name to RssReadings
    access_points : sequence of AccessPoint
        Those of known position; the others are located by their readings.
    radio : RadioConfig
    config : MeasuredConfig
    heartbeat : Heartbeat

    Raises
    ------
    BadInput
        When no access point was heard often enough.
    """
    known = {ap.name: ap for ap in access_points}
    floor = geographic.free
    nodes = make_nodes(geographic.geometry, floor, config.node_side_m, config.most_nodes)
    side_m = _SEARCH_SIDES * config.node_side_m
    coarse = make_nodes(geographic.geometry, floor, side_m, config.search_nodes)
    blocks, predictions, notices = find_blocks(geographic), [], []
    names, heard = [], {name: int(own.heard.sum()) for name, own in readings.items()}
    for name, count in heard.items():
        if count >= config.least_readings:
            names.append(name)
            continue
        notices.append(
            f"{name} was heard {count_of(count, 'time')}; {config.least_readings} make a map"
        )

    cells = np.argwhere(geographic.reachable)

    def fit_one(name: str) -> PredictedAccessPoint:
        """Fit and predict one access point, with floor fields of its own: caches are not shared."""
        mean = MeanFunction(
            geographic, known.get(name), radio.antenna_height_m, radio.mount_radius_m, blocks
        )
        floors = FloorField(nodes), FloorField(coarse)
        one = _locate_and_fit(floors, mean, readings[name], name, radio, config)
        return predict_access_point(nodes, one, cells, name, radio)

    heartbeat(f"measured maps of {count_of(len(names), 'access point')}")
    with ThreadPoolExecutor(min(usable_cores(), _MOST_AT_ONCE)) as pool:
        for name, one in zip(names, pool.map(fit_one, names), strict=True):
            heartbeat(f"measured map of {name}, {count_of(len(readings[name]), 'reading')}")
            predictions.append(one)
    if not predictions:
        raise BadInput("; ".join(notices) or "no reading of signal strength lies on the way")
    return _assemble(geographic, cells, predictions, radio, tuple(notices))


def _locate_and_fit(
    floors: tuple[FloorField, FloorField],
    mean: MeanFunction,
    readings: RssReadings,
    name: str,
    radio: RadioConfig,
    config: MeasuredConfig,
) -> FittedAccessPoint:
    """Fit one access point, located by its readings where its position is not given."""
    if mean.access_point is not None or not config.locate:
        return fit_access_point(floors, mean, readings, config)
    found = locate(floors[1], mean, readings, config)
    x, y, z = (float(v) for v in found.position_m)
    point = AccessPoint(name, x, y, z, radio.power_dbm, radio.frequency_hz)
    mean = replace(mean, access_point=point)
    fitted = fit_access_point(floors, mean, readings, config, found.hyper)
    return replace(fitted, position_sd_m=found.sd_m())


def fit_access_point(
    floors: tuple[FloorField, FloorField],
    mean: MeanFunction,
    readings: RssReadings,
    config: MeasuredConfig,
    hyper: Hyperparameters | None = None,
) -> FittedAccessPoint:
    """Fit one access point's hyperparameters on part of the readings, the rest on all of them.

    Parameters
    ----------
    floors : (FloorField, FloorField)
        To fit on, and a coarser one for the hyperparameters.
    mean : MeanFunction
    readings : RssReadings
    config : MeasuredConfig
    hyper : Hyperparameters, optional
        If known, such as from locating it.
    """
    fine, coarse = floors
    heard = readings.only(readings.heard)
    if hyper is None:
        part = heard.only(_minutes_subset(heard.times_s, config.search_readings))
        # The loss of each block is a column: four times the search's time, for the same.
        alike = replace(mean, blocks=None)
        hyper = fit_field(Problem.of(coarse, alike, part, Receiver())).hyper
    if readings.heard.all() and config.saturation_dbm is None:
        return FittedAccessPoint(
            mean, readings, _fit_given(fine, mean, readings, Receiver(), hyper)
        )
    first = _fit_given(fine, mean, heard, Receiver(), hyper)
    receiver = _estimate_receiver(first, fine.nodes, mean, readings, config)
    return FittedAccessPoint(mean, readings, _fit_given(fine, mean, readings, receiver, hyper))


def _fit_given(
    floor: FloorField,
    mean: MeanFunction,
    readings: RssReadings,
    receiver: Receiver,
    hyper: Hyperparameters,
) -> Fit:
    return fit_field(Problem.of(floor, mean, readings, receiver), hyper, search=False)


def _minutes_subset(times_s: Floats, most: int) -> NDArray[np.int64]:
    """Indices of about `most` readings, in whole minutes spread evenly over the time."""
    if len(times_s) <= most:
        return np.arange(len(times_s))
    minute = np.floor((times_s - times_s.min()) / _CHUNK_S).astype(np.int64)
    minutes = np.unique(minute)
    keep = max(1, round(len(minutes) * most / len(times_s)))
    chosen = minutes[np.linspace(0, len(minutes) - 1, keep).round().astype(np.int64)]
    taken = np.flatnonzero(np.isin(minute, chosen))
    return taken[:: max(1, len(taken) // most)]


def _estimate_receiver(
    fit: Fit, nodes: Nodes, mean: MeanFunction, readings: RssReadings, config: MeasuredConfig
) -> Receiver:
    """The receiver's sensitivity threshold, and how often a strong packet is lost."""
    weakest = float(np.nanmin(readings.rss_dbm))
    threshold = weakest if config.threshold_dbm is None else config.threshold_dbm
    level = mean.map_design(readings.points_m) @ fit.posterior.beta[: mean.terms]
    level += nodes.weights(readings.points_m) @ fit.posterior.state[: len(nodes)]
    strong = level > threshold + _CLEARLY_ABOVE_DB
    lost = float((~readings.heard[strong]).mean()) if strong.any() else 0.0
    most = np.inf if config.saturation_dbm is None else config.saturation_dbm
    return Receiver(threshold, most, float(np.clip(lost, 1e-3, 0.99)))


def _assemble(
    geographic: GeographicMap,
    cells: NDArray[np.int64],
    predictions: Sequence[PredictedAccessPoint],
    radio: RadioConfig,
    notices: tuple[str, ...],
) -> MeasuredMap:
    """Assemble the map from the predictions of cells (N, 2)."""
    shape = (len(predictions), *geographic.geometry.shape)
    layers = [np.full(shape, np.nan, dtype=np.float32) for _ in range(3)]
    for index, one in enumerate(predictions):
        for layer, values in zip(layers, one.levels, strict=True):
            layer[index][tuple(cells.T)] = values
    return MeasuredMap(
        geographic.geometry,
        tuple(one.access_point for one in predictions),
        mean_dbm=layers[0],
        mean_sd_db=layers[1],
        reading_sd_db=layers[2],
        fitted=tuple(one.terms for one in predictions),
        antenna_height_m=radio.antenna_height_m,
        notices=notices,
    )
