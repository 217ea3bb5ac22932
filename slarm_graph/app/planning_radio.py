# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A radio map over a map_server map, and plans with it: coverage, access points, paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.app.map_images import of_layers, save_map
from slarm_graph.app.measuring import RadioInput, measured_map, save_measured
from slarm_graph.app.outputs import save_radio
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.backend import SlamResult
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.maps import read_map
from slarm_graph.files.run_files import map_file as map_in
from slarm_graph.files.texts import csv_of, csv_text
from slarm_graph.files.trajectories import read_trajectory, trajectory_file
from slarm_graph.frontends.signals.rss import open_rss
from slarm_graph.geographic import GeographicMap, as_geographic
from slarm_graph.radio.connectivity.candidate_sites import CandidateSite, rank_sites
from slarm_graph.radio.connectivity.coverage import connections
from slarm_graph.radio.connectivity.paths import ConnectedPath, connected_path
from slarm_graph.radio.connectivity.signal import (
    PERCENTILES,
    Connection,
    SignalMap,
    noise_floor_dbm,
)
from slarm_graph.radio.fading import fading_maps, write_fading
from slarm_graph.radio.propagation.over_map import make_model, predicted_radio_map

Point = tuple[float, float]
Save = Callable[[RunFolder], None]

BANDWIDTH_HZ, NOISE_FIGURE_DB = 20e6, 7.0
"""A Wi-Fi channel and a usual receiver (IEEE 802.11 designs); 3 dB of either shift SNR as much."""


@dataclass(frozen=True, slots=True)
class RadioOverMap:
    """A radio map, predicted or measured, over a map_server map.

    Parameters
    ----------
    geographic : GeographicMap
    signal : SignalMap
    words : str
        What was made, as a line for the user.
    save : callable
        Writes its files into a run folder.
    radio : RadioMap or None
        None for a measured radio map.
    notices : tuple of str
        For the user.
    """

    geographic: GeographicMap
    signal: SignalMap
    words: str
    save: Save
    radio: RadioMap | None = None
    notices: tuple[str, ...] = ()

    def save_fading(self, folder: RunFolder, count: int, outage_dbm: float, seed: int) -> str:
        """Write `fading.npz` with realisations of fading; return a line that sums them up.

        Raises
        ------
        BadInput
            When the map is measured: its readings contain their fading.
        """
        if self.radio is None:
            raise BadInput("--fading draws from a predicted map; a measured one has its own spread")
        maps = fading_maps(self.radio, count, np.random.default_rng(seed), threshold_dbm=outage_dbm)
        with folder.replacing("fading.npz") as temporary:
            write_fading(temporary, maps)
        mean = float(np.nanmean(maps.outage_probability))
        return (
            f"{count} realisations: {mean:.2%} of the links below {outage_dbm:g} dBm -> fading.npz"
        )


def radio_over_map(
    map_file: Path,
    points: Sequence[AccessPoint],
    rss: Sequence[str],
    trajectory: Path | None,
    config: RunConfig,
) -> RadioOverMap:
    """Make the radio map over a map_server map: measured from readings, else predicted."""
    geographic = as_geographic(read_map(map_in(map_file)), config.recovery.default_height_m)
    if not geographic.accessible.any():
        raise BadInput(f"{map_file}: no cell of the map is free; is `negate` or a threshold wrong?")
    if rss:
        return _measured(geographic, points, rss, trajectory, config)
    radio = predicted_radio_map(geographic, points, config)
    low, high = radio.gain_span_db()
    names = ", ".join(ap.name for ap in points)
    words = f"{names}: expected gain {low:.1f} to {high:.1f} dB"

    def save(folder: RunFolder) -> None:
        """Write the radio map."""
        save_radio(folder, radio, config.radio)

    return RadioOverMap(geographic, SignalMap.of_prediction(radio), words, save, radio)


def _measured(
    geographic: GeographicMap,
    points: Sequence[AccessPoint],
    rss: Sequence[str],
    trajectory: Path | None,
    config: RunConfig,
) -> RadioOverMap:
    if trajectory is None:
        raise BadInput("--rss needs --trajectory: where in the map the robot was when it heard")
    logs = [open_rss(one) for one in rss]
    slam = SlamResult(read_trajectory(trajectory_file(trajectory)))
    measured = measured_map(geographic, RadioInput(logs, slam, points, config))
    names = ", ".join(ap.name for ap in measured.access_points)
    signal = SignalMap.of_measured(measured)

    def save(folder: RunFolder) -> None:
        """Write the measured map."""
        save_measured(folder, measured)

    return RadioOverMap(geographic, signal, f"{names}: measured", save, notices=measured.notices)


def save_connections(
    signal: SignalMap, threshold_dbm: float, folder: RunFolder
) -> tuple[Connection, ...]:
    """Write `connectivity.csv`, `connectivity.npz` and a costmap layer; return the rows."""
    made = connections(signal, threshold_dbm)
    facts = [asdict(one) for one in made]
    levels = [f"level_{p:g}_percent_dbm" for p in PERCENTILES]
    columns = [name for name in facts[0] if name != "percentiles_dbm"]
    rows = [[*(one[c] for c in columns), *one["percentiles_dbm"]] for one in facts]
    folder.write_text("connectivity.csv", csv_text([*columns, *levels], rows))
    noise_dbm = noise_floor_dbm(BANDWIDTH_HZ, NOISE_FIGURE_DB)
    with folder.replacing("connectivity.npz") as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            best_server=signal.best_server(),
            best_level_dbm=signal.best_level_dbm(),
            outage=signal.outage(threshold_dbm),
            snr_db=signal.snr_db(noise_dbm),
            sinr_db=signal.sinr_db(noise_dbm),
            threshold_dbm=threshold_dbm,
            noise_dbm=noise_dbm,
        )
    covered = signal.covered(threshold_dbm)
    # As a map_server map: free where connected, occupied where not; nav2 takes it as a layer.
    layers = of_layers(signal.cells & ~covered, covered)
    save_map(folder, "connectivity", signal.geometry, layers)
    return made


def save_sites(
    made: RadioOverMap,
    height_m: float,
    threshold_dbm: float,
    config: RunConfig,
    folder: RunFolder,
) -> tuple[CandidateSite, ...]:
    """Write `one_more.csv`, places for one more access point; return them, the best first."""
    sites = rank_sites(
        made.geographic,
        made.signal,
        make_model(config),
        config.radio,
        height_m=height_m,
        threshold_dbm=threshold_dbm,
    )
    folder.write_text("one_more.csv", csv_of([asdict(site) for site in sites]))
    return sites


def plan_paths(
    signal: SignalMap,
    ends: tuple[Point, Point],
    threshold_dbm: float,
    longest_outage_s: float,
    config: RunConfig,
    folder: RunFolder,
) -> Iterator[str]:
    """Plan paths from A to B and write them to `ways.csv`; yield a line on each."""
    level = signal.best_level_dbm()
    speed = config.explore.driving.speed_m_s
    asked = {
        "shortest": (math.inf, 0.0),
        f"connected, out for {longest_outage_s:g} s at most": (longest_outage_s * speed, 0.0),
        "shortest, weighed by what is missing": (math.inf, _PER_DB),
    }
    rows: list[tuple[object, ...]] = []
    for name, (outage_m, weight) in asked.items():
        path = connected_path(
            signal.geometry,
            level,
            *ends,
            threshold_dbm,
            longest_outage_m=outage_m,
            weight_per_db=weight,
        )
        if path is None:
            yield f"{name}: there is no such path"
            continue
        points = signal.geometry.center_of(path.cells)
        rows += [(name, f"{x:.3f}", f"{y:.3f}") for x, y in points.tolist()]
        yield _line(name, path)
    folder.write_text("ways.csv", csv_text(("way", "x_m", "y_m"), rows))


_PER_DB = 0.2
"""A metre 5 dB below the threshold counts double; halved, detours get shorter."""


def _line(name: str, path: ConnectedPath) -> str:
    return (
        f"{name}: {path.length_m:.1f} m, {path.below_m:.1f} m below the threshold"
        f" ({path.longest_below_m:.1f} m in one go), weakest {path.least_dbm:.1f} dBm"
    )
