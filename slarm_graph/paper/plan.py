# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What to drive for the paper's figures: one closed loop per cell size, speed, backend and seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Final, Literal, TypeVar

from slarm_graph import parts
from slarm_graph.app.trials import Trial, TrialSource
from slarm_graph.errors import BadInput

PAPER_ROOM: Final = "paper_room"
RESOLUTIONS_M: Final = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25)
"""Sides of cells of the paper's figure 5 [m]."""
SPEEDS_M_S: Final = (0.2, 0.6, 1.0)
"""Speeds of the paper's figure 5 [m/s]."""
BACKENDS: Final = ("pose_graph", "gmapping")
FIGURE_RESOLUTIONS_M: Final = (0.05, 0.1, 0.25)
"""Those of the paper's figures 3 and 4."""

Prior = Literal["extent", "extent+sizes"]
Expansion = Literal["cell", "robot", "zero"]
EXPANSIONS: Final[tuple[Expansion, ...]] = ("cell", "robot", "zero")
"""R_e: one cell as the paper presets it, the robot's radius, none."""
PRIORS: Final[tuple[Prior, ...]] = ("extent+sizes", "extent")


Word = TypeVar("Word", bound=str)


@dataclass(frozen=True, slots=True)
class Setting:
    """What one closed loop of the reproduction is about; its seed apart."""

    explorer: str
    backend: str
    resolution_m: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run and what of it to show.

    Parameters
    ----------
    resolutions_m, speeds_m_s : tuple of float
    backends, explorers : tuple of str
        `ggmr` is the paper's Algorithm 1, which drives to every reachable cell.
    priors, expansions : tuple of str
        Each drive is recovered with all of them.
    seeds : int
        Number of seeds per setting, counted from 0.
    """

    resolutions_m: tuple[float, ...] = RESOLUTIONS_M
    speeds_m_s: tuple[float, ...] = SPEEDS_M_S
    backends: tuple[str, ...] = BACKENDS
    explorers: tuple[str, ...] = ("ggmr", "ggmr+")
    priors: tuple[Prior, ...] = PRIORS
    expansions: tuple[Expansion, ...] = EXPANSIONS
    seeds: int = 5

    def trials(self, folder: Path) -> dict[Trial, Setting]:
        """Return every closed loop, the quickest first: what is there early can be looked at."""
        every = product(
            range(self.seeds),
            sorted(self.resolutions_m, reverse=True),
            sorted(self.speeds_m_s, reverse=True),
            self.explorers,
            self.backends,
        )
        settings = ((seed, Setting(e, b, delta, speed)) for seed, delta, speed, e, b in every)
        return {_trial(folder, setting, seed): setting for seed, setting in settings}


QUICK: Final = Plan(resolutions_m=(0.1, 0.25), speeds_m_s=(1.0,), explorers=("ggmr",), seeds=1)
"""The minute's version, at the speed of the paper's best figure; cells of 0.05 m alone would take
longer than both of these."""


def _trial(folder: Path, s: Setting, seed: int) -> Trial:
    name = f"{s.explorer}_{s.backend}_{s.resolution_m:g}m_{s.speed_m_s:g}ms_{seed}"
    options = (
        *("--explorer", s.explorer),
        *("--resolution", f"{s.resolution_m:g}", "--speed", f"{s.speed_m_s:g}"),
        *("--set", "explore.judge_variants=true"),
    )
    room = TrialSource(PAPER_ROOM, is_world=True)
    return Trial(room, s.backend, seed, folder.resolve() / "runs" / name, options)


def plan_of(
    quick: bool,
    explorers: str | None,
    prior: str | None,
    expansions: str | None,
    resolutions: str | None,
    speeds: str | None,
    seeds: int | None,
) -> Plan:
    """Return the plan that the words ask for.

    Raises
    ------
    BadInput
        Naming the option and what it may be.
    """
    plan = QUICK if quick else Plan()
    if explorers is not None:
        plan = replace(plan, explorers=_words(explorers))
        for name in plan.explorers:
            parts.find("explorer", name)
    if prior is not None:
        plan = replace(plan, priors=_among("--prior", prior, PRIORS))
    if expansions is not None:
        plan = replace(plan, expansions=_among("--expansion", expansions, EXPANSIONS))
    if resolutions is not None:
        plan = replace(plan, resolutions_m=_numbers("--resolutions", resolutions))
    if speeds is not None:
        plan = replace(plan, speeds_m_s=_numbers("--speeds", speeds))
    return plan if seeds is None else replace(plan, seeds=seeds)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _among(option: str, text: str, allowed: tuple[Word, ...]) -> tuple[Word, ...]:
    found = tuple(word for word in allowed if word in _words(text))
    if not found or len(found) != len(_words(text)):
        raise BadInput(f"{option} {text}: give one or more of {', '.join(allowed)}")
    return found


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        found = tuple(float(word) for word in _words(text))
    except ValueError:
        found = ()
    if not found or min(found) <= 0.0:
        raise BadInput(f"{option} {text}: give positive numbers with commas between them")
    return found
