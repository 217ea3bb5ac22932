# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured radio map of a furnished flat beside its peers, by blocks of floor left out.

Run with `python benchmarks/bench_measured_radio.py FOLDER`, a folder with the flat's
`calibration_df.csv`, `anchors.csv` and `layout.csv` (Kolakowski, Sensors 21:6270, CC BY 4.0).
Peers of the same run, on the same folds: the prediction alone (3GPP InH), a fitted log-distance
law, scikit-learn's Gaussian process without walls, PyKrige's ordinary kriging.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pykrige.ok import OrdinaryKriging
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import MeasuredConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.polygons import contains
from slarm_graph.radio.measured.build_map import fit_access_point
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import RssReadings
from slarm_graph.radio.measured.validate import (
    FOLDS,
    Predicted,
    block_folds,
    predict_readings,
)
from slarm_graph.radio.path_loss import path_loss_db
from slarm_graph.radio.propagation.over_map import links_to

ANTENNA_M, FREQUENCY_HZ = 0.3, 2.44e9
"""Of the robot (by eye; the mean's level absorbs it), and of BLE's middle channel."""

GP_READINGS, KRIGING_READINGS = 600, 1000
"""Peers search their kernels, and krige, on so many readings: all take minutes."""

NEARLY_GAUSSIAN = 1e6
"""Degrees of freedom of peers' predictive distributions."""


@dataclass
class Scores:
    """Errors, hits of the 95 % interval and log scores of one method."""

    errors: list[Floats] = field(default_factory=list)
    within: list[Floats] = field(default_factory=list)
    logs: list[Floats] = field(default_factory=list)

    def add(self, predicted: Predicted, rss_dbm: Floats) -> None:
        """Count the readings of a fold."""
        self.errors.append(rss_dbm - predicted.mean_dbm)
        self.within.append(predicted.within(rss_dbm))
        self.logs.append(predicted.log_score(rss_dbm))

    def line(self, name: str) -> str:
        """Return a row of the table."""
        rmse = np.sqrt(np.mean(np.concatenate(self.errors) ** 2))
        within = np.concatenate(self.within).mean()
        score = np.concatenate(self.logs).mean()
        return f"{name:40s} {rmse:7.3f} {100 * within:7.1f} {score:8.3f}"


def columns(path: Path) -> dict[str, Floats]:
    """Read a CSV of numbers; what is empty becomes nan."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key] or "nan") for row in rows]) for key in rows[0]}


def flat_map(folder: Path) -> GeographicMap:
    """Rasterise the flat's outline: what lies outside is wall."""
    table = columns(folder / "layout.csv")
    outline = np.column_stack([table["x"], table["y"]])
    low, high = outline.min(axis=0) - 0.2, outline.max(axis=0) + 0.2
    grid = GridGeometry.covering(low[0], high[0], low[1], high[1], 0.05)
    free = contains(outline, grid.centers())
    states = np.where(free, CellState.ACCESSIBLE, CellState.OBSTACLE).astype(np.uint8)
    heights = np.where(free, 0.0, np.inf).astype(np.float32)
    return GeographicMap(grid, states, heights, "infinite", Coverage(free, free, free))


def readings_of(table: dict[str, Floats], number: int) -> RssReadings:
    """Readings of an anchor that were heard; whole decibels are single packets (class 1)."""
    rss = table[f"rssi_{number}"]
    single = (rss == np.round(rss)).astype(np.int64)
    points = np.column_stack([table["x"], table["y"]])
    times = (table["ts"] - table["ts"][0]) * 1e-9
    everything = RssReadings(points, times, rss, single, table["heading"] + np.pi, classes=2)
    return everything.only(everything.heard)


def gaussian(mean: Floats, sd: Floats) -> Predicted:
    """A peer's answer."""
    return Predicted(mean, np.broadcast_to(sd, mean.shape), NEARLY_GAUSSIAN)


def gaussian_process(kernel: object, known: RssReadings, asked: RssReadings) -> Predicted:
    """Fit scikit-learn's Gaussian process to the plan coordinates."""
    rng = np.random.default_rng(0)
    level = known.rss_dbm.mean()
    some = rng.choice(len(known), min(GP_READINGS, len(known)), replace=False)
    search = GaussianProcessRegressor(ConstantKernel(20.0) * kernel + WhiteKernel(20.0))
    search.fit(known.points_m[some], known.rss_dbm[some] - level)
    process = GaussianProcessRegressor(search.kernel_, optimizer=None)
    process.fit(known.points_m, known.rss_dbm - level)
    mean, sd = process.predict(asked.points_m, return_std=True)
    return gaussian(level + mean, sd)


def kriging(known: RssReadings, asked: RssReadings) -> Predicted:
    """Krige the plan coordinates; PyKrige's variance is that of the mean, without the nugget."""
    rng = np.random.default_rng(0)
    some = rng.choice(len(known), min(KRIGING_READINGS, len(known)), replace=False)
    apart = known.points_m[some] + 1e-3 * rng.normal(size=(len(some), 2))
    kriged = OrdinaryKriging(*apart.T, known.rss_dbm[some], variogram_model="spherical")
    mean, variance = kriged.execute("points", *asked.points_m.T)
    nugget = float(kriged.variogram_model_parameters[-1])
    return gaussian(np.asarray(mean), np.sqrt(np.asarray(variance) + nugget))


def log_distance(ap: AccessPoint, known: RssReadings, asked: RssReadings) -> Predicted:
    """Fit level and exponent by least squares."""

    def rows(readings: RssReadings) -> Floats:
        """Return the design (N, 2)."""
        flat = np.linalg.norm(readings.points_m - ap.position_m()[:2], axis=1)
        return np.column_stack([np.ones(len(flat)), np.log10(np.hypot(flat, ap.z_m - ANTENNA_M))])

    fitted, *_ = np.linalg.lstsq(rows(known), known.rss_dbm, rcond=None)
    sd = np.std(known.rss_dbm - rows(known) @ fitted)
    return gaussian(rows(asked) @ fitted, sd)


def prediction(mean: MeanFunction, known: RssReadings, asked: RssReadings) -> Predicted:
    """Take 3GPP InH as it is; the power is the mean level, for no data sheet gives it."""
    ap = mean.access_point
    assert ap is not None

    def loss(readings: RssReadings) -> Floats:
        """Return the expected loss (N,) [dB]."""
        links = links_to(
            mean.geographic.geometry,
            mean.geographic.heights_m,
            ap,
            readings.points_m,
            antenna_height_m=mean.antenna_height_m,
            mount_radius_m=mean.mount_radius_m,
        )
        return path_loss_db(links.distance_m, ap.frequency_hz, links.line_of_sight, "InH")

    power = (known.rss_dbm + loss(known)).mean()
    return gaussian(power - loss(asked), np.std(known.rss_dbm + loss(known)))


def peers(mean: MeanFunction, known: RssReadings, asked: RssReadings) -> dict[str, Predicted]:
    """Return the answers of all peers."""
    assert mean.access_point is not None
    return {
        "prediction alone (3GPP InH)": prediction(mean, known, asked),
        "log-distance, fitted": log_distance(mean.access_point, known, asked),
        "scikit-learn GP, RBF": gaussian_process(RBF(1.0, (0.1, 10.0)), known, asked),
        "scikit-learn GP, Matern 1/2": gaussian_process(
            Matern(1.0, (0.1, 30.0), nu=0.5), known, asked
        ),
        "PyKrige ordinary kriging, spherical": kriging(known, asked),
    }


def main() -> None:
    """Print one row per method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0, help="of the deal of blocks into folds")
    parser.add_argument("--no-peers", action="store_true")
    given = parser.parse_args()
    geographic = flat_map(given.folder)
    table = columns(given.folder / "calibration_df.csv")
    anchors = columns(given.folder / "anchors.csv")
    config = MeasuredConfig()
    nodes = make_nodes(geographic.geometry, geographic.free, config.node_side_m, 20_000)
    floors = FloorField(nodes), FloorField(nodes)
    folds = block_folds(
        np.column_stack([table["x"], table["y"]]), np.random.default_rng(given.seed)
    )
    scores: dict[str, Scores] = {}
    for number, x, y, z in zip(*(anchors[key] for key in ("id", "x", "y", "z")), strict=True):
        name = int(number)
        ap = AccessPoint(f"anchor {name}", x, y, z, 0.0, FREQUENCY_HZ)
        mean = MeanFunction(geographic, ap, ANTENNA_M, 0.25)
        heard = np.isfinite(table[f"rssi_{name}"])
        everything = readings_of(table, name)
        for fold in range(FOLDS):
            out = folds[heard] == fold
            known, asked = everything.only(~out), everything.only(out)
            one = fit_access_point(floors, mean, known, config)
            answers = {
                "fused map + drift": predict_readings(one.fit, nodes, mean, asked),
                "fused map alone": predict_readings(one.fit, nodes, mean, asked, with_drift=False),
            }
            if not given.no_peers:
                answers |= peers(mean, known, asked)
            for label, answer in answers.items():
                scores.setdefault(label, Scores()).add(answer, asked.rss_dbm)
        print(f"{ap.name}: {len(everything)} readings, {one.fit.hyper}", flush=True)
    print(f"{'':40s} {'RMSE dB':>7s} {'in 95 %':>7s} {'log':>8s}")
    for label, score in scores.items():
        print(score.line(label))


if __name__ == "__main__":
    main()
