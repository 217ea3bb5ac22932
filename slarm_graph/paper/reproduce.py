# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures and its claims beside ours, from closed loops in its room.

Every trial is `slarm explore`: a robot that finds the room out, measured against the truth with
nothing aligned, in a process and a run folder of its own. Trials that have ended are not run again.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.app.compare import compare
from slarm_graph.app.outcomes import read_outcome
from slarm_graph.app.progress import Progress
from slarm_graph.app.trials import Trial
from slarm_graph.backend import silent
from slarm_graph.config import DrivingConfig, RunConfig
from slarm_graph.eval.comparison import Outcome
from slarm_graph.files.worlds import load_world
from slarm_graph.paper.figures import (
    Curve,
    save_accuracy_figure,
    save_complexity_figure,
    save_gain_figure,
    save_times_figure,
)
from slarm_graph.paper.plan import FIGURE_RESOLUTIONS_M, PAPER_ROOM, Plan, Setting
from slarm_graph.paper.theory import (
    PAPER_BEST,
    PAPER_COARSE,
    Complexity,
    complexity,
    mission_accuracy,
    one_cell_ring_accuracy,
)
from slarm_graph.radio.files import read_radio_npz
from slarm_graph.radio.radio_map import theoretical_radio_map
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

MISSION_S: Final = 1800.0
"""Of the hypothesis of a fixed mission time: half an hour, in which 0.05 m is just driven."""
_PAPER_POINTS: Final = ((0.05, PAPER_BEST, "paper, 1 m/s"), (0.15, PAPER_COARSE, "paper"))
_EXPANSION_NAMES: Final = {"cell": "one cell", "robot": "robot radius", "zero": "0"}


@dataclass(frozen=True, slots=True)
class Row:
    """Mean and standard deviation over the seeds of one setting, prior and expansion."""

    explorer: str
    backend: str
    resolution_m: float
    speed_m_s: float
    prior: str
    expansion: str
    seeds: int
    accuracy: float
    accuracy_sd: float
    accuracy_min: float
    ate_rmse_m: float
    drive_time_s: float
    planning_s: float
    wall_s: float
    collisions: float


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A guess at what the paper measured, from the true room without SLAM error."""

    name: str
    resolution_m: float
    speed_m_s: float
    accuracy: float


def reproduce(
    folder: Path,
    plan: Plan,
    *,
    jobs: int | None = None,
    tell: Callable[[str], None] = silent,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Run what is missing, then write tables and figures into a folder.

    Parameters
    ----------
    folder : Path
        Exists; gets `results.csv`, `complexity.csv`, `hypotheses.csv` and the figures as PNG.
    plan : Plan
    jobs : int, optional
        Processes at a time; as many as there are processors by default.
    tell : callable
        Told about progress, one line at a time.
    progress : Progress, optional
    """
    world = load_world(PAPER_ROOM)
    _theory(folder, world, plan)
    trials = plan.trials(folder)
    outcomes = {trial: read_outcome(trial) for trial in trials}
    missing = [trial for trial, outcome in outcomes.items() if outcome.status != "ok"]
    if len(missing) < len(trials):
        tell(f"{len(trials) - len(missing)} of {len(trials)} closed loops are there already")

    def told(outcome: Outcome) -> None:
        """Say what came of a closed loop."""
        accuracy = outcome.figures.get("accuracy", float("nan"))
        tell(f"{outcome.folder}: {outcome.status}, accuracy {accuracy:.4f}")

    ran = compare(missing, workers=jobs, tell=told, progress=progress) if missing else ()
    outcomes |= dict(zip(missing, ran, strict=True))
    show(folder, plan, outcomes)
    return tuple(outcomes.values())


def show(folder: Path, plan: Plan, outcomes: Mapping[Trial, Outcome]) -> None:
    """Write tables and figures of what has ended well so far."""
    settings = plan.trials(folder)
    done = {trial: outcome for trial, outcome in outcomes.items() if outcome.status == "ok"}
    rows = summarise([(settings[trial], outcome) for trial, outcome in done.items()], plan)
    if not rows:
        return
    _write_rows(folder / "results.csv", rows)
    guesses = hypotheses(load_world(PAPER_ROOM), plan)
    _write_rows(folder / "hypotheses.csv", guesses)
    for explorer in plan.explorers:
        mine = [row for row in rows if row.explorer == explorer]
        if not mine:
            continue
        name = explorer.replace("+", "_plus")
        curves = [*_curves(mine), *_guessed(guesses)]
        save_accuracy_figure(
            folder / f"fig5_{name}.png", _figure_title(explorer, mine), curves, _PAPER_POINTS
        )
        save_times_figure(folder / f"times_{name}.png", explorer, _times(mine))
        for backend in plan.backends:
            maps = _shown_maps(done, settings, explorer, backend)
            title = (
                f"Figure 4: gain after a closed loop of {explorer} with {backend}, a drive of its"
                " own per cell size"
            )
            save_gain_figure(folder / f"fig4_{name}_{backend}.png", title, maps)


def summarise(outcomes: Sequence[tuple[Setting, Outcome]], plan: Plan) -> list[Row]:
    """Gather the seeds of every setting, prior and expansion."""
    rows = []
    for setting in sorted({s for s, _ in outcomes}, key=lambda s: tuple(asdict(s).values())):
        figures = [outcome.figures for s, outcome in outcomes if s == setting]
        for prior in plan.priors:
            for expansion in plan.expansions:
                name = variant_name(expansion, with_sizes=prior == "extent+sizes")
                rows.append(_row(setting, prior, expansion, figures, name))
    return rows


def variant_name(expansion: str, *, with_sizes: bool) -> str:
    """Key of the metric of a drive recovered with an expansion radius and sizes or none."""
    return f"accuracy_re_{expansion}_{'with' if with_sizes else 'without'}_sizes"


def _row(
    setting: Setting, prior: str, expansion: str, figures: Sequence[Mapping[str, float]], name: str
) -> Row:
    def mean(key: str) -> float:
        """Mean over the seeds."""
        return float(np.mean([one.get(key, np.nan) for one in figures]))

    accuracy = np.array([one.get(name, np.nan) for one in figures])
    return Row(
        **asdict(setting),
        prior=prior,
        expansion=expansion,
        seeds=len(figures),
        accuracy=float(accuracy.mean()),
        accuracy_sd=float(accuracy.std()),
        accuracy_min=float(accuracy.min()),
        ate_rmse_m=mean("ate_rmse_unaligned_m"),
        drive_time_s=mean("drive_time_s"),
        planning_s=mean("planning_s"),
        wall_s=mean("wall_s"),
        collisions=mean("collisions"),
    )


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


def _theory(folder: Path, world: WorldMap, plan: Plan) -> None:
    """Figure 3, and Algorithm 1 counted on the true room."""
    table = [complexity(world, d, DrivingConfig()) for d in plan.resolutions_m]
    _write_rows(folder / "complexity.csv", table)
    save_complexity_figure(folder / "complexity.png", table)
    config = RunConfig().radio
    maps = [
        (d, theoretical_radio_map(world, truth_map(world, d).geometry, config))
        for d in FIGURE_RESOLUTIONS_M
        if d in plan.resolutions_m
    ]
    save_gain_figure(
        folder / "fig3_theoretical.png", "Figure 3: theoretical channel power gain", maps
    )


def _shown_maps(
    done: Mapping[Trial, Outcome],
    settings: Mapping[Trial, Setting],
    explorer: str,
    backend: str,
) -> list[tuple[float, RadioMap]]:
    """Radio maps of the figure's cell sizes: of the first seed, at the speed nearest 0.6 m/s."""
    found = []
    for delta in FIGURE_RESOLUTIONS_M:
        mine = [
            (abs(settings[trial].speed_m_s - 0.6), trial.seed, trial.folder)
            for trial in done
            if (settings[trial].explorer, settings[trial].backend) == (explorer, backend)
            and settings[trial].resolution_m == delta
        ]
        if mine:
            found.append((delta, read_radio_npz(min(mine)[2] / "radio_map.npz")))
    return found


def _figure_title(explorer: str, rows: Sequence[Row]) -> str:
    seeds = sorted({row.seeds for row in rows})
    count = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"
    what = "the paper's Algorithm 1, " if explorer == "ggmr" else ""
    return (
        f"Figure 5: accuracy of the radio map, {explorer} ({what}every reachable cell driven to,"
        f" a drive of its own per cell size, speed and seed; {count} seeds)"
    )


def _curves(rows: Sequence[Row]) -> list[Curve]:
    """Lines of figure 5: a panel per expansion, a line per backend, speed and prior."""
    curves = []
    for key in sorted({(r.expansion, r.backend, r.speed_m_s, r.prior) for r in rows}):
        mine = [r for r in rows if (r.expansion, r.backend, r.speed_m_s, r.prior) == key]
        expansion, backend, speed, prior = key
        sizes = "with sizes" if prior == "extent+sizes" else "without sizes"
        curves.append(
            Curve(
                f"{backend}, {speed:g} m/s, {sizes}",
                f"R_e = {_EXPANSION_NAMES[expansion]}",
                [r.resolution_m for r in mine],
                [r.accuracy for r in mine],
                [r.accuracy_sd for r in mine],
            )
        )
    return curves


def _guessed(guesses: Sequence[Hypothesis]) -> list[Curve]:
    """Lines of the panel of hypotheses."""
    curves = []
    for name, speed in sorted({(g.name, g.speed_m_s) for g in guesses}):
        mine = [g for g in guesses if (g.name, g.speed_m_s) == (name, speed)]
        label = name if speed == 0.0 else f"{name}, {speed:g} m/s"
        x, y = [g.resolution_m for g in mine], [g.accuracy for g in mine]
        curves.append(Curve(label, "hypotheses, no SLAM error", x, y, [0.0] * len(x)))
    return curves


def _times(rows: Sequence[Row]) -> dict[str, list[tuple[float, float, float, float]]]:
    """Drive, planning and wall time over the cell size, per backend and speed."""
    lines: dict[str, list[tuple[float, float, float, float]]] = {}
    for row in rows:
        point = (row.resolution_m, row.drive_time_s, row.planning_s, row.wall_s)
        line = lines.setdefault(f"{row.backend}, {row.speed_m_s:g} m/s", [])
        if point not in line:
            line.append(point)
    return lines


def _write_rows(path: Path, rows: Iterable[Row | Hypothesis | Complexity]) -> None:
    records = [asdict(row) for row in rows]
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(records[0]))
        writer.writeheader()
        writer.writerows(records)
    unfinished.replace(path)
