# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures against the chains of matches alone and of odometry alone."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.backends.chain_consistency import contradict_both_chains
from slarm_graph.constraint import Constraint, ConstraintKind
from slarm_graph.frontends.scans.closures import GATE_CHI2
from slarm_graph.geometry import Floats, Pose2, between, compose

STEP, COUNT = np.array([1.0, 0.1, 0.08]), 20
NOISE = np.array([0.03, 0.02, 0.02])
SURE = np.diag([1e-3, 1e-3, 1e-3]) ** 2
MATCHES, WHEELS = ConstraintKind.SCAN_MATCH, ConstraintKind.ODOMETRY


def chain(kind: ConstraintKind, sigmas: Floats = NOISE, turned: float = 0.0) -> list[Constraint]:
    """A chain of equal steps, the fifth of which may be turned wrongly."""
    return [
        Constraint(
            k,
            k + 1,
            Pose2.from_array(STEP + (k == 4) * np.array([0, 0, turned])),
            np.diag(sigmas**2),
            kind,
        )
        for k in range(COUNT)
    ]


def driven(steps: int) -> Floats:
    """Where steps without errors lead to (3,)."""
    pose = np.zeros(3)
    for _ in range(steps):
        pose = compose(pose, STEP)
    return pose


def led_to(rng: np.random.Generator) -> Floats:
    """Where steps that err as `chain` says lead to (3,)."""
    pose = np.zeros(3)
    for _ in range(COUNT):
        pose = compose(pose, compose(STEP, NOISE * rng.standard_normal(3)))
    return pose


def found_at(pose: Floats) -> Constraint:
    return Constraint(0, COUNT, Pose2.from_array(pose), SURE, ConstraintKind.LOOP_CLOSURE)


def is_contradicted(closure: Constraint, steps: list[Constraint]) -> bool:
    (answer,) = contradict_both_chains([closure], steps)
    return answer


def test_the_gate_is_that_of_the_drawn_covariance() -> None:
    """The covariance of drawn chains is the oracle."""
    rng = np.random.default_rng(0)
    expected = driven(COUNT)
    off = between(expected, np.array([led_to(rng) for _ in range(2000)]))
    spread = np.cov(off.T)
    steps = [*chain(MATCHES), *chain(WHEELS)]
    least, most = 0.85 * np.sqrt(GATE_CHI2), 1.15 * np.sqrt(GATE_CHI2)
    for direction in np.linalg.cholesky(spread).T:
        assert not is_contradicted(found_at(compose(expected, least * direction)), steps)
        assert is_contradicted(found_at(compose(expected, most * direction)), steps)


@pytest.mark.parametrize("wrong", [MATCHES, WHEELS])
def test_a_closure_that_one_chain_allows_is_kept(wrong: ConstraintKind) -> None:
    right = WHEELS if wrong is MATCHES else MATCHES
    sure = np.array([1e-3, 1e-3, 1e-3])
    true = driven(COUNT)
    steps = [*chain(wrong, sure, turned=0.3), *chain(right, sure)]
    assert not is_contradicted(found_at(true), steps)
    both = [*chain(wrong, sure, turned=0.3), *chain(right, sure, turned=0.3)]
    assert is_contradicted(found_at(true), both)
    silent = [s for s in both if s.j != 7 or s.kind is wrong]
    assert not is_contradicted(found_at(true), silent)


def test_only_the_steps_between_the_nodes_count() -> None:
    sure = np.array([1e-3, 1e-3, 1e-3])
    steps = [*chain(MATCHES, sure, turned=0.3), *chain(WHEELS, sure, turned=0.3)]
    there = driven(6)
    after = Constraint(5, 11, Pose2.from_array(there), SURE, ConstraintKind.LOOP_CLOSURE)
    assert not is_contradicted(after, steps)
    over = Constraint(4, 10, Pose2.from_array(there), SURE, ConstraintKind.LOOP_CLOSURE)
    assert is_contradicted(over, steps)


def test_an_uncertain_closure_is_not_rejected() -> None:
    steps = [*chain(MATCHES), *chain(WHEELS)]
    there = Pose2.from_array(compose(driven(COUNT), np.array([8.0, 0.0, 0.0])))
    for sigma_m, is_rejected in ((1e-3, True), (4.0, False)):
        covariance = np.diag([sigma_m, sigma_m, 0.1]) ** 2
        closure = Constraint(0, COUNT, there, covariance, ConstraintKind.LOOP_CLOSURE)
        assert is_contradicted(closure, steps) == is_rejected
