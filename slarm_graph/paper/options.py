# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From the words of the command line to a plan."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from slarm_graph import parts
from slarm_graph.errors import BadInput
from slarm_graph.paper.plan import EXPANSIONS, PRIORS, QUICK, Plan

Word = TypeVar("Word", bound=str)


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
