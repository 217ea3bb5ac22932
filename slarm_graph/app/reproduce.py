# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures and its complexity table beside ours, from closed loops in its room.

Every trial is a robot that does not know the room: simulator, SLAM backend, explorer, recovery and
radio map, measured against the truth with nothing aligned. Trials run in processes of their own.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Final, Literal

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.app.reproduce_figures import (
    Curve,
    save_accuracy_figure,
    save_complexity_figure,
    save_gain_figure,
)
from slarm_graph.app.reproduce_theory import (
    PAPER_BEST,
    PAPER_COARSE,
    Complexity,
    complexity,
    mission_accuracy,
    one_cell_ring_accuracy,
)
from slarm_graph.app.reproduce_trial import PAPER_ROOM, RoomTrial, Row, run_trial
from slarm_graph.backend import silent
from slarm_graph.config import DrivingConfig, RunConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.radio.radio_map import theoretical_radio_map
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

RESOLUTIONS_M: Final = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25)
"""Sides of cells of the paper's figures 4 to 6, and finer ones than it has."""
SPEEDS_M_S: Final = (0.2, 0.6, 1.0)
"""Speeds of the paper's figure 5 [m/s]."""
BACKENDS: Final = ("pose_graph", "gmapping")
FIGURE_RESOLUTIONS_M: Final = (0.05, 0.1, 0.25)
"""Those of the paper's maps of the channel gain."""
MISSION_S: Final = 1800.0
"""The paper gives its robot half an hour."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run.

    Parameters
    ----------
    resolutions_m, speeds_m_s : tuple of float
    backends : tuple of str
    seeds : int
        Number of seeds per setting, counted from 0.
    explorer : str
    goal : str
        What `ggmr+` is after, `observed` or `footprint`.
    """

    resolutions_m: tuple[float, ...] = RESOLUTIONS_M
    speeds_m_s: tuple[float, ...] = SPEEDS_M_S
    backends: tuple[str, ...] = BACKENDS
    seeds: int = 5
    explorer: str = "ggmr+"
    goal: Literal["observed", "footprint"] = "observed"

    def trials(self) -> tuple[RoomTrial, ...]:
        """Return every combination, the slowest first so that processes end together."""
        every = product(
            sorted(self.speeds_m_s), self.backends, self.resolutions_m, range(self.seeds)
        )
        return tuple(RoomTrial(b, d, v, s, self.explorer, self.goal) for v, b, d, s in every)


QUICK: Final = Plan(resolutions_m=FIGURE_RESOLUTIONS_M, speeds_m_s=(0.6,), seeds=1)
"""The minute's version."""


def reproduce(
    folder: Path,
    plan: Plan,
    *,
    jobs: int | None = None,
    tell: Callable[[str], None] = silent,
) -> tuple[Row, ...]:
    """Run all trials and write tables and figures into a folder.

    Parameters
    ----------
    folder : Path
        Exists; gets `results.csv`, `summary.csv`, `complexity.csv`, `hypotheses.csv` and the
        figures as PNG.
    plan : Plan
    jobs : int, optional
        Processes at a time; as many as there are processors by default.
    tell : callable
        Told about progress, one line at a time.
    """
    world = load_world(PAPER_ROOM)
    driving = DrivingConfig()
    table = [complexity(world, d, driving) for d in plan.resolutions_m]
    _write_rows(folder / "complexity.csv", table)
    save_complexity_figure(folder / "complexity.png", table)
    _theory_figure(folder, world, plan)
    rows, gains = _run_all(plan.trials(), folder / "results.csv", jobs, tell)
    summary = summarise(rows)
    _write_rows(folder / "summary.csv", summary)
    guesses = hypotheses(world, plan)
    _write_rows(folder / "hypotheses.csv", guesses)
    save_accuracy_figure(folder / "fig5_accuracy.png", _curves(summary, guesses), _PAPER_POINTS)
    for backend in plan.backends:
        title = f"Figure 4: channel power gain after a closed loop with {backend}"
        maps = [(t.resolution_m, radio) for t, radio in gains if t.backend == backend]
        save_gain_figure(folder / f"fig4_{backend}.png", title, maps)
    return rows


_PAPER_POINTS: Final = ((0.05, PAPER_BEST, "paper, 1 m/s"), (0.15, PAPER_COARSE, "paper"))


@dataclass(frozen=True, slots=True)
class Summary:
    """Mean and standard deviation over the seeds of one setting."""

    backend: str
    resolution_m: float
    speed_m_s: float
    seeds: int
    accuracy: float
    accuracy_sd: float
    accuracy_min: float
    accuracy_ring: float
    accuracy_ring_sd: float
    false_accessible: float
    false_accessible_max: float
    ate_rmse_m: float
    drive_time_s: float
    collisions: int
    cpu_s: float


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A guess at what the paper measured, from the true room without SLAM error."""

    name: str
    resolution_m: float
    speed_m_s: float
    accuracy: float


def summarise(rows: Sequence[Row]) -> list[Summary]:
    """Gather the seeds of every setting."""
    settings = sorted({(r.backend, r.resolution_m, r.speed_m_s) for r in rows})
    return [_summary([r for r in rows if _setting(r) == s]) for s in settings]


def hypotheses(world: WorldMap, plan: Plan) -> list[Hypothesis]:
    """Return both labelled hypotheses: R_e = one cell, and a fixed mission time."""
    found = []
    for resolution_m in plan.resolutions_m:
        ring = one_cell_ring_accuracy(world, resolution_m)
        found.append(Hypothesis("R_e = one cell", resolution_m, 0.0, ring))
        for speed_m_s in plan.speeds_m_s:
            driving = DrivingConfig(speed_m_s=speed_m_s)
            in_time = mission_accuracy(world, resolution_m, driving, MISSION_S)
            name = f"R_e = one cell, {MISSION_S / 60:.0f} min mission"
            found.append(Hypothesis(name, resolution_m, speed_m_s, in_time))
    return found


def _setting(row: Row) -> tuple[str, float, float]:
    return row.backend, row.resolution_m, row.speed_m_s


def _in_order(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: (*_setting(row), row.seed))


def _summary(rows: Sequence[Row]) -> Summary:
    accuracy = np.array([r.accuracy for r in rows])
    ring = np.array([r.accuracy_ring for r in rows])
    false = np.array([r.false_accessible for r in rows])
    return Summary(
        *_setting(rows[0]),
        len(rows),
        float(accuracy.mean()),
        float(accuracy.std()),
        float(accuracy.min()),
        float(ring.mean()),
        float(ring.std()),
        float(false.mean()),
        float(false.max()),
        float(np.mean([r.ate_rmse_m for r in rows])),
        float(np.mean([r.drive_time_s for r in rows])),
        sum(r.collisions for r in rows),
        float(np.mean([r.cpu_s for r in rows])),
    )


def _run_all(
    trials: Sequence[RoomTrial], table: Path, jobs: int | None, tell: Callable[[str], None]
) -> tuple[tuple[Row, ...], list[tuple[RoomTrial, RadioMap]]]:
    """Run the trials in parallel; the table on disk is complete up to the last one that ended.

    Returns the rows, and the radio maps that figure 4 shows.
    """
    rows: list[Row] = []
    gains: list[tuple[RoomTrial, RadioMap]] = []
    workers = min(jobs or os.cpu_count() or 1, len(trials))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        pending = {pool.submit(run_trial, trial): trial for trial in trials}
        for done in as_completed(pending):
            trial, (row, radio) = pending.pop(done), done.result()
            rows.append(row)
            if _is_shown(trial):
                gains.append((trial, radio))
            _write_rows(table, _in_order(rows))
            tell(
                f"{len(rows)} of {len(trials)}: {row.backend}, {row.resolution_m:g} m,"
                f" {row.speed_m_s:g} m/s, seed {row.seed}: accuracy {row.accuracy:.4f}"
            )
    return tuple(_in_order(rows)), sorted(gains, key=lambda g: g[0].resolution_m)


def _is_shown(trial: RoomTrial) -> bool:
    shown = trial.resolution_m in FIGURE_RESOLUTIONS_M
    return shown and trial.speed_m_s == 0.6 and trial.seed == 0


def _write_rows(path: Path, rows: Iterable[Row | Summary | Hypothesis | Complexity]) -> None:
    records = [asdict(row) for row in rows]
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(records[0]))
        writer.writeheader()
        writer.writerows(records)
    unfinished.replace(path)


def _curves(summary: Sequence[Summary], guesses: Sequence[Hypothesis]) -> list[Curve]:
    """Lines of figure 5: ours per backend and speed, ours with R_e = one cell, hypotheses."""
    curves = []
    for backend, speed in sorted({(s.backend, s.speed_m_s) for s in summary}):
        mine = [s for s in summary if (s.backend, s.speed_m_s) == (backend, speed)]
        x = [s.resolution_m for s in mine]
        means, sds = [s.accuracy for s in mine], [s.accuracy_sd for s in mine]
        curves.append(Curve(f"{backend}, {speed:g} m/s", "ours", x, means, sds))
        ring = [s.accuracy_ring for s in mine], [s.accuracy_ring_sd for s in mine]
        curves.append(Curve(f"{backend}, {speed:g} m/s", "R_e = one cell", x, *ring))
    for name, speed in sorted({(g.name, g.speed_m_s) for g in guesses}):
        mine_too = [g for g in guesses if (g.name, g.speed_m_s) == (name, speed)]
        label = name if speed == 0.0 else f"{name}, {speed:g} m/s"
        x, y = [g.resolution_m for g in mine_too], [g.accuracy for g in mine_too]
        curves.append(Curve(label, "hypothesis", x, y, [0.0] * len(x)))
    return curves


def _theory_figure(folder: Path, world: WorldMap, plan: Plan) -> None:
    config = RunConfig().radio
    resolutions = [d for d in FIGURE_RESOLUTIONS_M if d in plan.resolutions_m]
    maps = [theoretical_radio_map(world, truth_map(world, d).geometry, config) for d in resolutions]
    title = "Figure 3: theoretical channel power gain"
    save_gain_figure(
        folder / "fig3_theoretical.png", title, list(zip(resolutions, maps, strict=True))
    )
