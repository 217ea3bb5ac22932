# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures and its claims beside ours, from closed loops in its room.

Every trial is `slarm explore`: a robot that finds the room out, measured against the truth with
nothing aligned, in a process and a run folder of its own. Trials that have ended are not run again:
those with a run folder, and those in the table of drives, which may come from another machine.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from slarm_graph.access_points import RadioMap
from slarm_graph.app.compare import compare
from slarm_graph.app.outcomes import read_outcome
from slarm_graph.app.progress import Progress
from slarm_graph.app.trials import Trial
from slarm_graph.backend import silent
from slarm_graph.config import DrivingConfig, RunConfig
from slarm_graph.counts import count_of
from slarm_graph.eval.comparison import Outcome
from slarm_graph.files.worlds import load_world
from slarm_graph.paper.drives import DRIVES, outcome_of, read_drives, write_drives
from slarm_graph.paper.figures import (
    save_accuracy_figure,
    save_complexity_figure,
    save_gain_figure,
    save_times_figure,
)
from slarm_graph.paper.plan import FIGURE_RESOLUTIONS_M, PAPER_ROOM, Plan, Setting
from slarm_graph.paper.summary import (
    PAPER_POINTS,
    Hypothesis,
    Row,
    guessed_curves,
    measured_curves,
    summarise,
    times_of,
)
from slarm_graph.paper.theory import (
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


def reproduce(
    folder: Path,
    plan: Plan,
    *,
    elsewhere: Sequence[Path] = (),
    jobs: int | None = None,
    tell: Callable[[str], None] = silent,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Run what is missing, and write tables and figures into a folder, anew after every seed.

    Parameters
    ----------
    folder : Path
        Exists; gets `drives.csv`, `results.csv`, `complexity.csv`, `hypotheses.csv` and the
        figures as PNG. What the table of drives holds counts as driven.
    plan : Plan
    elsewhere : sequence of Path
        Tables of drives from other folders, which count as well.
    jobs : int, optional
        Processes at a time; as many as there are processors by default.
    tell : callable
        Told about progress, one line at a time.
    progress : Progress, optional

    Raises
    ------
    BadInput
        Naming the table that is missing, or the line of one that is none.
    """
    before: dict[str, dict[str, str]] = {}
    for path in elsewhere:
        before |= read_drives(path)
    if (folder / DRIVES).is_file():
        before |= read_drives(folder / DRIVES)
    _theory(folder, load_world(PAPER_ROOM), plan)
    trials = plan.trials(folder)
    outcomes = _outcomes(trials, before)
    write_drives(folder / DRIVES, outcomes.items(), before)
    missing = [trial for trial, outcome in outcomes.items() if outcome.status != "ok"]
    if len(missing) < len(trials):
        tell(f"{len(trials) - len(missing)} of {len(trials)} closed loops are there already")

    per_seed, ended = len(trials) // plan.seeds, list[Outcome]()

    def told(outcome: Outcome) -> None:
        """Say what came of a closed loop, and show what is there when a seed's have all ended."""
        accuracy = outcome.figures.get("accuracy", float("nan"))
        tell(f"{outcome.folder}: {outcome.status}, accuracy {accuracy:.4f}")
        ended.append(outcome)
        now = _outcomes(trials, before)
        write_drives(folder / DRIVES, now.items(), before)
        if len(ended) < len(missing) and len(ended) % per_seed == 0:
            show(folder, plan, now)

    ran = compare(missing, workers=jobs, tell=told, progress=progress) if missing else ()
    outcomes |= dict(zip(missing, ran, strict=True))
    show(folder, plan, outcomes)
    return tuple(outcomes.values())


def _outcomes(
    trials: Iterable[Trial], table: Mapping[str, Mapping[str, str]]
) -> dict[Trial, Outcome]:
    """What each closed loop came to, by its run folder or else by the table."""
    found = {trial: read_outcome(trial) for trial in trials}
    listed = {t: outcome_of(t, table[t.folder.name]) for t in found if t.folder.name in table}
    return {t: listed.get(t, o) if o.status != "ok" else o for t, o in found.items()}


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
        curves = [*measured_curves(mine), *guessed_curves(guesses)]
        save_accuracy_figure(
            folder / f"fig5_{name}.png", _figure_title(explorer, mine), curves, PAPER_POINTS
        )
        save_times_figure(folder / f"times_{name}.png", explorer, times_of(mine))
        for backend in plan.backends:
            maps = _shown_maps(done, settings, explorer, backend)
            title = (
                f"Figure 4: gain after a closed loop of {explorer} with {backend}, a drive of its"
                " own per cell size"
            )
            save_gain_figure(folder / f"fig4_{name}_{backend}.png", title, maps)


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
        mine = [one for one in mine if (one[2] / "radio_map.npz").is_file()]
        if mine:
            found.append((delta, read_radio_npz(min(mine)[2] / "radio_map.npz")))
    return found


def _figure_title(explorer: str, rows: Sequence[Row]) -> str:
    seeds = sorted({row.seeds for row in rows})
    count = count_of(seeds[-1], "seed")
    count = count if len(seeds) == 1 else f"{seeds[0]} to {count}"
    what = "the paper's Algorithm 1, " if explorer == "ggmr" else ""
    return (
        f"Figure 5: accuracy of the radio map, {explorer} ({what}every reachable cell driven to,"
        f" a drive of its own per cell size, speed and seed; {count})"
    )


def _write_rows(path: Path, rows: Iterable[Row | Hypothesis | Complexity]) -> None:
    records = [asdict(row) for row in rows]
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(records[0]))
        writer.writeheader()
        writer.writerows(records)
    unfinished.replace(path)
