# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Universal kriging with sparse precisions: joint posterior of field, drift and mean coefficients.

Readings are `y = B beta + A z + noise`; the state z is the field at the nodes and the drift over
time, with a sparse prior precision Q, and beta the coefficients of the propagation model with a
Gaussian prior. With noise precisions W everything follows from the factor of F = Q + A' W A: the
inverse of the readings' covariance is W - W A F^-1 A' W (Woodbury), its log determinant that of F
less those of Q and W.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.factor import Factor, Ints
from slarm_graph.radio.measured.priors import Precision

_COLUMNS_AT_A_TIME = 32
"""Right-hand sides solved at once: of 5500 rows each takes 0.32 ms, alone 0.46 and by 256, which
leave the cache, 0.57."""

_DENSE = 512
"""Readings up to which their precision matrix is kept dense: two megabytes. The part of the
readings that rules positions out first has some 375: with half of this it goes by the factor,
1.9 ms a position in place of 0.7."""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Prior of the mean's coefficients: means (p,) and standard deviations (p,)."""

    mean: Floats
    sd: Floats


@dataclass(frozen=True, slots=True)
class Posterior:
    """Gaussian posterior of field, drift and coefficients.

    Parameters
    ----------
    factor : Factor
        Of Q + A' W A.
    state : (S,) float64
        Posterior mean of field and drift [dB].
    beta : (p,) float64
        Posterior mean of the coefficients.
    beta_covariance : (p, p) float64
    state_per_beta : (S, p) float64
        Minus the derivative of the state's conditional mean with respect to the coefficients.
    log_evidence : float
        Log marginal likelihood of the readings.
    """

    factor: Factor
    state: Floats
    beta: Floats
    beta_covariance: Floats
    state_per_beta: Floats
    log_evidence: float

    def mean(self, design: Floats, observation: sparse.csr_array) -> Floats:
        """Return the posterior mean (N,) for rows of design (N, p) and of observation (N, S)."""
        return np.asarray(design @ self.beta + observation @ self.state)

    def variance(self, design: Floats, observation: sparse.csr_array) -> Floats:
        """Return the exact posterior variance (N,) of it [dB^2]; a solve for each row."""
        variance = np.empty(observation.shape[0])
        for first in range(0, len(variance), _COLUMNS_AT_A_TIME):
            rows = slice(first, first + _COLUMNS_AT_A_TIME)
            dense = observation[rows].toarray()
            solved = self.factor.solve(dense.T)
            variance[rows] = np.einsum("ij,ji->i", dense, solved)
        return variance + self.coefficient_variance(design, observation @ self.state_per_beta)

    def coefficient_variance(self, design: Floats, explained: Floats) -> Floats:
        """Return the variance (N,) due to the coefficients [dB^2]."""
        open_part = design - explained
        return np.asarray(((open_part @ self.beta_covariance) * open_part).sum(axis=1))


class FactoredModel:
    """Prior of the state, observation matrix and noise, factored once for any design.

    Parameters
    ----------
    prior : Precision
        Of the state, (S, S).
    observation : (N, S) sparse
        A.
    noise_precision : (N,) [1/dB^2]
        Positive.
    order : (S,) int32, optional
        Elimination order, as of a model of the same sparsity pattern.
    """

    def __init__(
        self,
        prior: Precision,
        observation: sparse.csr_array,
        noise_precision: Floats,
        order: Ints | None = None,
    ) -> None:
        self._prior, self._observation = prior, observation
        self._weighted = sparse.csr_array(observation.multiply(noise_precision[:, None]))
        self._factor = Factor(
            sparse.csc_array(prior.matrix + self._weighted.T @ observation), order
        )
        self.order = self._factor.order
        self._precision = noise_precision
        self._dense: Floats | None = None
        self._log_determinant = (
            self._factor.log_determinant()
            - prior.log_determinant
            - float(np.log(noise_precision).sum())
        )

    def inner(self, columns: Floats) -> Floats:
        """Return the inner products (C, C) of columns (N, C) under the readings' precision."""
        return self._inner(columns)[0]

    def log_evidences(
        self, designs: Floats, coefficients: Coefficients, readings_dbm: Floats
    ) -> Floats:
        """Return the log evidence (K,) of designs (K, N, p), as `condition` has it."""
        at_once = max(1, _COLUMNS_AT_A_TIME // designs.shape[2])
        applied_readings = self._applied(readings_dbm[:, None])[:, 0]
        logs = np.empty(len(designs))
        for first in range(0, len(designs), at_once):
            some = designs[first : first + at_once]
            inner = self._inner_each(some, readings_dbm, applied_readings)
            # Of the readings less their prior mean, and the design, from what was solved.
            of_both = np.eye(inner.shape[1])
            of_both[1:, 0] = -coefficients.mean
            inner = of_both.T @ inner @ of_both
            logs[first : first + at_once] = self._log_evidence(inner, coefficients)[0]
        return logs

    def _inner_each(
        self, designs: Floats, readings_dbm: Floats, applied_readings: Floats
    ) -> Floats:
        """Inner products (K, 1 + p, 1 + p) of readings and each design (K, N, p)."""
        count, size, terms = designs.shape
        columns = designs.transpose(1, 0, 2).reshape(size, count * terms)
        of_designs = self._applied(columns).reshape(size, count, terms).transpose(1, 0, 2)
        inner = np.empty((count, 1 + terms, 1 + terms))
        inner[:, 0, 0] = readings_dbm @ applied_readings
        inner[:, 1:, 0] = inner[:, 0, 1:] = applied_readings @ designs
        inner[:, 1:, 1:] = designs.transpose(0, 2, 1) @ of_designs
        return inner

    def _applied(self, columns: Floats) -> Floats:
        """Return the readings' precision matrix times columns (N, C); dense where N is small."""
        if len(columns) > _DENSE:
            solved = self._factor.solve(self._weighted.T @ columns)
            return np.asarray(self._precision[:, None] * columns - self._weighted @ solved)
        if self._dense is None:
            self._dense = self.inner(np.eye(len(columns)))
        return np.asarray(self._dense @ columns)

    def _log_evidence(
        self, inner: Floats, coefficients: Coefficients
    ) -> tuple[Floats, Floats, Floats]:
        """Log evidence (...), posterior precision (..., p, p) and mean (..., p) of coefficients.

        From the inner products (..., 1 + p, 1 + p) of readings, less their prior mean, and design;
        the mean is relative to that of the prior.
        """
        onto = inner[..., 1:, 0]
        beta_precision = inner[..., 1:, 1:] + np.diag(coefficients.sd**-2)
        step = np.linalg.solve(beta_precision, onto[..., None])[..., 0]
        fit = inner[..., 0, 0] - (onto * step).sum(axis=-1)
        spread = np.linalg.slogdet(beta_precision)[1] + 2.0 * np.log(coefficients.sd).sum()
        constant = len(self._precision) * np.log(2.0 * np.pi)
        evidence = -0.5 * (fit + self._log_determinant + spread + constant)
        return np.asarray(evidence), beta_precision, np.asarray(step)

    def _inner(self, columns: Floats) -> tuple[Floats, Floats]:
        """Inner products (C, C), and the posterior mean of the state (S, C) for each column."""
        onto_state = self._weighted.T @ columns
        solved = self._factor.solve(onto_state)
        inner: Floats = columns.T @ (self._precision[:, None] * columns) - onto_state.T @ solved
        return inner, solved

    def condition(
        self, design: Floats, coefficients: Coefficients, readings_dbm: Floats
    ) -> Posterior:
        """Condition field, drift and coefficients on readings.

        Parameters
        ----------
        design : (N, p)
            B.
        coefficients : Coefficients
        readings_dbm : (N,) [dBm]
        """
        at_mean = readings_dbm - design @ coefficients.mean
        both = np.column_stack([at_mean, design])
        inner, solved = self._inner(both)
        evidence, beta_precision, step = self._log_evidence(inner, coefficients)
        return Posterior(
            self._factor,
            solved[:, 0] - solved[:, 1:] @ step,
            coefficients.mean + step,
            np.asarray(np.linalg.inv(beta_precision)),
            solved[:, 1:],
            float(evidence),
        )

    def evidence_changes(
        self,
        posterior: Posterior,
        design: Floats,
        readings_dbm: Floats,
        others: Sequence[tuple[Precision, Floats]],
    ) -> Floats:
        """Return the changes (K,) of the log evidence under other priors and noises, first order.

        By Fisher's identity that is the posterior expectation of the change of the joint log
        density of readings, field, drift and coefficients.

        Parameters
        ----------
        posterior : Posterior
            By `condition`, of design (N, p) and readings (N,) [dBm].
        others : sequence of (Precision, (N,) float64)
            Near to this one's prior and noise precisions [1/dB^2].
        """
        observation, coefficients = self._observation, np.linalg.cholesky(posterior.beta_covariance)
        state = np.column_stack([posterior.state, posterior.state_per_beta @ coefficients])
        off_db2 = (readings_dbm - posterior.mean(design, observation)) ** 2
        off_db2 += posterior.coefficient_variance(design, observation @ posterior.state_per_beta)
        changes, moved = np.empty(len(others)), []
        for k, (prior, precision) in enumerate(others):
            change = sparse.csc_array(prior.matrix - self._prior.matrix)
            noise = precision - self._precision
            moved.append(
                change + sparse.csc_array(observation.T @ observation.multiply(noise[:, None]))
            )
            changes[k] = prior.log_determinant - self._prior.log_determinant
            changes[k] += (noise / self._precision - noise * off_db2).sum()
            changes[k] -= (state * (change @ state)).sum()
        return np.asarray(0.5 * (changes - self._factor.traces(moved)))
