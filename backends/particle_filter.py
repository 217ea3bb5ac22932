# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Weights, selective resampling and ancestry of particles, independent of their state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from filterpy.monte_carlo import multinomial_resample, stratified_resample, systematic_resample
from numpy.random import Generator
from numpy.typing import NDArray

from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.kernels import kernel

Indices = NDArray[np.int64]


def normalised(log_weights: Floats) -> Floats:
    """Turn log weights (P,) into weights that sum to 1, without under- or overflow."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def effective_sample_size(weights: Floats) -> float:
    """N_eff = 1 / sum w^2 of weights (P,) that sum to 1: from 1 to P."""
    return float(1.0 / np.square(weights).sum())


def weighted_mean(poses: Floats, weights: Floats) -> Floats:
    """Mean (..., 3) of poses (..., P, 3), circular for the heading, eq. (11) with weights (P,)."""
    x, y = poses[..., 0] @ weights, poses[..., 1] @ weights
    theta = np.arctan2(np.sin(poses[..., 2]) @ weights, np.cos(poses[..., 2]) @ weights)
    return np.stack([x, y, wrap_angles(theta)], axis=-1)


def resample(weights: Floats, method: str, rng: Generator) -> Indices:
    """Draw ancestors (P,) so that particle i is expected P * weights[i] times.

    Parameters
    ----------
    weights : (P,) float64
        Summing to 1.
    method : str
        `systematic`, `stratified`, `residual` or `multinomial`.
    rng : Generator
    """
    safe = weights / weights.sum()
    # Rounding must not leave the cumulative sum below filterpy's last position.
    safe[-1] += max(0.0, 1.0 - np.cumsum(safe)[-1])
    with _numpy_seeded_by(rng):
        if method == "systematic":
            drawn = systematic_resample(safe)
        elif method == "stratified":
            drawn = stratified_resample(safe)
        elif method == "multinomial":
            drawn = multinomial_resample(safe)
        else:
            drawn = _residual(safe)
    return np.asarray(drawn, dtype=np.int64)


def _residual(weights: Floats) -> Indices:
    """Keep floor(P w) copies of each and draw the rest from what remains.

    filterpy 1.4.5's `residual_resample` subtracts the copies from w instead of P w, which biases
    the rest; only its multinomial part is used.
    """
    expected = len(weights) * weights
    copies = np.floor(expected).astype(np.int64)
    kept = np.repeat(np.arange(len(weights)), copies)
    remaining = expected - copies
    if len(kept) >= len(weights):
        return kept[: len(weights)]
    drawn = multinomial_resample(remaining / remaining.sum())
    return np.concatenate([kept, drawn[: len(weights) - len(kept)]])


@contextmanager
def _numpy_seeded_by(rng: Generator) -> Iterator[None]:
    """Lend filterpy, which draws from numpy's global state, a seed; leave that state unchanged."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(int(rng.integers(2**32)))  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


class Ancestry:
    """Ancestry tree of the particles with their poses: paths are shared, never copied."""

    def __init__(self, particles: int) -> None:
        self._length = 0
        self._poses: Floats = np.empty((64, particles, 3))
        self._parents: Indices = np.empty((64, particles), dtype=np.int64)

    def __len__(self) -> int:
        return self._length

    def append(self, parents: Indices, poses: Floats) -> None:
        """Add an update.

        Parameters
        ----------
        parents : (P,) int64
            Parent of each particle at the previous update.
        poses : (P, 3) float64
            After resampling.
        """
        if self._length == len(self._poses):
            self._poses = np.concatenate([self._poses, np.empty_like(self._poses)])
            self._parents = np.concatenate([self._parents, np.empty_like(self._parents)])
        self._poses[self._length], self._parents[self._length] = poses, parents
        self._length += 1

    def path(self, particle: int) -> Floats:
        """Poses (U, 3) of the whole ancestry of a particle of the last update."""
        return self.paths(np.array([particle]))[:, 0]

    def paths(self, particles: Indices) -> Floats:
        """Poses (U, M, 3) of the ancestries of M particles of the last update."""
        out = np.empty((self._length, len(particles), 3))
        ancestors = particles
        for update in range(self._length - 1, -1, -1):
            out[update] = self._poses[update, ancestors]
            ancestors = self._parents[update, ancestors]
        return out

    def common_update(self) -> int:
        """Return the last update at which all particles have a common ancestor, -1 if none."""
        return int(_common_update(self._parents[: self._length]))


@kernel
def _common_update(parents: Indices) -> int:
    updates, particles = parents.shape
    ancestors = np.arange(particles)
    for update in range(updates - 1, -1, -1):
        if (ancestors == ancestors[0]).all():
            return update
        for i in range(particles):
            ancestors[i] = parents[update, ancestors[i]]
    return -1
