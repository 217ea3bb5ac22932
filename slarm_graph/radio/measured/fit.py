# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Fit one access point: hyperparameters by marginal likelihood, Student's t and censored noise.

Not Gaussian noise is handled by the Laplace approximation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.optimize import minimize
from scipy.special import gammaln

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.factor import Ints
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.posterior import Coefficients, FactoredModel, Posterior
from slarm_graph.radio.measured.priors import (
    FloorField,
    Precision,
    drift_precision,
    field_correlation,
)
from slarm_graph.radio.measured.readings import Receiver, RssReadings, gaussian_equivalent

DRIFT_STEP_S = 1.0
"""Step of the drift's state: a robot at walking pace passes about a wavelength meanwhile."""

_DEGREES_OF_FREEDOM = (3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 100.0)
"""Candidates for Student's t: from nearly infinite variance to nearly Gaussian."""

_ROUNDS = 2
"""Of weights and hyperparameters in alternation; a third changed no score of the flat by 0.2 %."""

_TOLERANCE_NATS = 0.02
"""Gain in log evidence that ends the search [nats]; differences below one nat mean nothing."""

_STEP = 1e-5
"""Step in log hyperparameters over which priors and noise are taken to be linear: with 300 readings
gradients are off by 0.001 nats, by 0.01 with ten times the step. Finite differences of the evidence
itself over 0.01 were off by more than a search had left to gain, and line searches took twenty
steps."""

_NEWTON_STEPS = 4
"""Newton steps of the Laplace approximation; the fifth moves nothing by 0.05 dB."""


@dataclass(frozen=True, slots=True)
class Hyperparameters:
    """Of one access point's residual field, drift and noise.

    Parameters
    ----------
    range_m : float
        Distance at which the field's correlation has fallen to 0.14 [m].
    field_sd_db : float
    drift_sd_db, drift_s : float
        Of the drift, which changes with time and not with place, and its correlation time [s].
    noise_sd_db : (K,) float64
        Scale of the noise of every class of readings.
    freedom : float
        Degrees of freedom of that noise (Student's t).
    """

    range_m: float
    field_sd_db: float
    drift_sd_db: float
    drift_s: float
    noise_sd_db: Floats
    freedom: float = 8.0

    def vector(self) -> Floats:
        """Return the logarithms (4 + K,) of all but the degrees of freedom."""
        scales = [self.range_m, self.field_sd_db, self.drift_sd_db, self.drift_s]
        return np.log([*scales, *self.noise_sd_db])

    def moved(self, vector: Floats) -> Hyperparameters:
        """Return the hyperparameters of such a vector, with the same degrees of freedom."""
        scales = np.exp(vector)
        reach, field, drift, time = (float(v) for v in scales[:4])
        return Hyperparameters(reach, field, drift, time, scales[4:], self.freedom)


_TYPICAL = (3.0, 5.0, 2.0, 5.0, 4.0)
"""Median of the weak hyperprior: range [m], field and drift [dB], correlation time of the drift
[s], noise [dB]. Indoor shadowing has 3 to 8 dB and decorrelates within some metres (TR 38.901 Table
7.5-6)."""

_TYPICAL_SD = (0.8, 0.7, 0.7, 1.0, 0.7)
"""Standard deviation of the hyperprior in natural logarithms: a factor 2 to 2.7 either way."""


@dataclass(frozen=True, slots=True)
class Fit:
    """The fitted model of one access point.

    Parameters
    ----------
    hyper : Hyperparameters
    posterior : Posterior
    drift_times_s : (T,) float64
        Times of the drift's state; the state is the field's nodes and then these.
    readings : int
        Number of readings fitted.
    """

    hyper: Hyperparameters
    posterior: Posterior
    drift_times_s: Floats
    readings: int

    def reading_sd_db(self) -> float:
        """Standard deviation of a new single reading about the map [dB], drift included."""
        hyper = self.hyper
        spread = hyper.freedom / (hyper.freedom - 2.0)
        return float(np.sqrt(hyper.noise_sd_db[0] ** 2 * spread + hyper.drift_sd_db**2))


@dataclass(slots=True)
class Problem:
    """The regression of one access point's readings, all but the hyperparameters.

    Parameters
    ----------
    floor : FloorField
    readings : RssReadings
    design : (N, p) float64
        Rows of the propagation model's mean.
    coefficients : Coefficients
    mean_slope_db_m : (N,) float64
        How steep the mean is at the readings [dB/m].
    receiver : Receiver
    map_variance_db2 : (N,) float64
        Variance of the mean by wall position error, times the number of readings that share the
        error [dB^2]: n readings with a common error inform about their mean as n with independent
        errors of n times the variance.
    """

    floor: FloorField
    readings: RssReadings
    design: Floats
    coefficients: Coefficients
    mean_slope_db_m: Floats
    receiver: Receiver
    map_variance_db2: Floats
    _observation: sparse.csr_array | None = None
    _order: Ints | None = None

    @classmethod
    def of(
        cls, floor: FloorField, mean: MeanFunction, readings: RssReadings, receiver: Receiver
    ) -> Problem:
        """Return the regression of readings about a propagation model."""
        design, map_variance_db2 = mean.reading_design_and_variance(readings)
        map_variance_db2 *= floor.nodes.points_in_node(readings.points_m)
        slope = mean.distance_slope_db_m(readings.points_m)
        coefficients = mean.coefficients(readings)
        return cls(floor, readings, design, coefficients, slope, receiver, map_variance_db2)

    def drift_times_s(self) -> Floats:
        """Return the times (T,) of the drift's state [s]."""
        return np.unique(np.floor(self.readings.times_s / DRIFT_STEP_S)) * DRIFT_STEP_S

    def observation(self) -> sparse.csr_array:
        """Return the observation matrix A (N, S): weights of field nodes, and the drift's time."""
        if self._observation is None:
            times_s = self.drift_times_s()
            kept = np.floor(self.readings.times_s / DRIFT_STEP_S) * DRIFT_STEP_S
            rows, second = np.arange(len(kept)), times_s.searchsorted(kept)
            drift = sparse.csr_array(
                (np.ones(len(kept)), (rows, second)), shape=(len(kept), len(times_s))
            )
            field = self.floor.nodes.weights(self.readings.points_m)
            self._observation = sparse.csr_array(sparse.hstack([field, drift], format="csr"))
        return self._observation

    def factored(self, prior: Precision, noise_precision: Floats) -> FactoredModel:
        """Return the model with a prior and noise precisions (N,) [1/dB^2] factored."""
        made = FactoredModel(prior, self.observation(), noise_precision, self._order)
        self._order = made.order
        return made

    def prior(self, hyper: Hyperparameters) -> Precision:
        """Return the precision of field and drift together."""
        field = self.floor.unit_precision(hyper.range_m)
        drift = drift_precision(self.drift_times_s(), hyper.drift_s)
        parts = (
            field.matrix / hyper.field_sd_db**2,
            drift.matrix / hyper.drift_sd_db**2,
        )
        log_determinant = field.log_determinant + drift.log_determinant
        log_determinant -= 2.0 * field.matrix.shape[0] * np.log(hyper.field_sd_db)
        log_determinant -= 2.0 * drift.matrix.shape[0] * np.log(hyper.drift_sd_db)
        matrix = sparse.csc_array(sparse.block_diag(parts, format="csc"))
        return Precision(matrix, float(log_determinant))

    def noise_variance(self, hyper: Hyperparameters) -> Floats:
        """Return each reading's noise variance (N,) [dB^2], uncertain position included."""
        variance = hyper.noise_sd_db[self.readings.noise_class] ** 2 + self.map_variance_db2
        sd_m = self.readings.position_sd_m
        if sd_m is None:
            return np.asarray(variance)
        lost = 2.0 * hyper.field_sd_db**2 * (1.0 - field_correlation(sd_m, hyper.range_m))
        return np.asarray(variance + lost + (self.mean_slope_db_m * sd_m) ** 2)


def fit_field(
    problem: Problem, start: Hyperparameters | None = None, *, search: bool = True
) -> Fit:
    """Fit field, drift and coefficients to readings.

    Parameters
    ----------
    problem : Problem
    start : Hyperparameters, optional
        Initial ones, or final ones without a search.
    search : bool
        Whether hyperparameters are optimised.
    """
    readings = problem.readings
    hyper = start or _initial_hyperparameters(problem)
    expected_dbm = np.full(len(readings), float(np.nanmedian(readings.rss_dbm)))
    for _ in range(_ROUNDS if search else 1):
        posterior, expected_dbm, weights = _laplace_posterior(problem, hyper, expected_dbm)
        if search:
            hyper = _maximise_evidence(problem, hyper, expected_dbm, weights)
    posterior, expected_dbm, _ = _laplace_posterior(problem, hyper, expected_dbm)
    return Fit(hyper, posterior, problem.drift_times_s(), len(readings))


def factored_at(problem: Problem, fit: Fit) -> tuple[FactoredModel, Floats]:
    """Return the model factored at a fit, and the Gaussian-equivalent readings (N,) [dBm]."""
    variance = problem.noise_variance(fit.hyper)
    expected_dbm = fit.posterior.mean(problem.design, problem.observation())
    values, weights = gaussian_equivalent(
        problem.readings.rss_dbm, expected_dbm, variance, problem.receiver, fit.hyper.freedom
    )
    return problem.factored(problem.prior(fit.hyper), weights / variance), values


def _initial_hyperparameters(problem: Problem) -> Hyperparameters:
    noise = np.full(problem.readings.classes, _TYPICAL[4])
    return Hyperparameters(*_TYPICAL[:4], noise)


def _laplace_posterior(
    problem: Problem, hyper: Hyperparameters, expected_dbm: Floats
) -> tuple[Posterior, Floats, Floats]:
    """Laplace approximation: posterior, expected readings and weights, by Newton's method."""
    variance = problem.noise_variance(hyper)
    prior = problem.prior(hyper)
    for _ in range(_NEWTON_STEPS):
        values, weights = gaussian_equivalent(
            problem.readings.rss_dbm, expected_dbm, variance, problem.receiver, hyper.freedom
        )
        factored = problem.factored(prior, weights / variance)
        posterior = factored.condition(problem.design, problem.coefficients, values)
        expected_dbm = posterior.mean(problem.design, problem.observation())
    return posterior, expected_dbm, weights


def _maximise_evidence(
    problem: Problem,
    hyper: Hyperparameters,
    expected_dbm: Floats,
    weights: Floats,
) -> Hyperparameters:
    """Hyperparameters of maximum marginal likelihood (times hyperprior) for given weights."""
    values, _ = gaussian_equivalent(
        problem.readings.rss_dbm,
        expected_dbm,
        problem.noise_variance(hyper),
        problem.receiver,
        hyper.freedom,
    )
    centre = np.log([*_TYPICAL[:4], *[_TYPICAL[4]] * len(hyper.noise_sd_db)])
    prior_sd = np.array([*_TYPICAL_SD[:4], *[_TYPICAL_SD[4]] * len(hyper.noise_sd_db)])

    def precisions(vector: Floats) -> tuple[Precision, Floats]:
        """Precision of the prior, and noise precisions (N,) [1/dB^2]."""
        tried = hyper.moved(vector)
        return problem.prior(tried), weights / problem.noise_variance(tried)

    def cost(vector: Floats) -> tuple[float, Floats]:
        """Negative log posterior of the hyperparameters, and its gradient."""
        factored = problem.factored(*precisions(vector))
        done = factored.condition(problem.design, problem.coefficients, values)
        near = [precisions(vector + step) for step in _STEP * np.eye(len(vector))]
        changes = factored.evidence_changes(done, problem.design, values, near)
        off = (vector - centre) / prior_sd
        return 0.5 * float(off @ off) - done.log_evidence, off / prior_sd - changes / _STEP

    bounds = list(zip(centre - 3.0 * prior_sd, centre + 3.0 * prior_sd, strict=True))
    options = {"maxiter": 12, "ftol": _TOLERANCE_NATS / len(values)}
    found = minimize(
        cost, hyper.vector(), jac=True, method="L-BFGS-B", bounds=bounds, options=options
    )
    best = hyper.moved(found.x)
    return replace(best, freedom=_fit_degrees_of_freedom(problem, best, expected_dbm))


def _fit_degrees_of_freedom(
    problem: Problem, hyper: Hyperparameters, expected_dbm: Floats
) -> float:
    """Maximum-likelihood degrees of freedom of the uncensored residuals."""
    heard = problem.readings.heard
    scaled = (problem.readings.rss_dbm - expected_dbm)[heard]
    scaled = scaled / np.sqrt(problem.noise_variance(hyper)[heard])
    return max(_DEGREES_OF_FREEDOM, key=lambda nu: float(log_student_t(scaled, nu).sum()))


def log_student_t(scaled: Floats, freedom: float) -> Floats:
    """Logarithm of Student's t density of unit scale (N,)."""
    constant = gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom)
    constant -= 0.5 * np.log(freedom * np.pi)
    return np.asarray(constant - 0.5 * (freedom + 1.0) * np.log1p(scaled**2 / freedom))
