# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Path loss, shadow fading and line-of-sight probability of 3GPP TR 38.901 (V19), indoors.

Every scenario is data: a law is `intercept + distance_slope log10(d_3D / m)
+ frequency_slope log10(f / GHz)`, and a blocked link takes the largest of its laws.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask


@dataclass(frozen=True, slots=True)
class Law:
    """One straight line in log distance and log frequency.

    Parameters
    ----------
    intercept_db, distance_slope_db, frequency_slope_db : float
        At 1 m and 1 GHz, per decade of metres, per decade of gigahertz.
    """

    intercept_db: float
    distance_slope_db: float
    frequency_slope_db: float

    def loss_db(self, log10_distance_m: Floats, log10_frequency_ghz: float) -> Floats:
        """Evaluate the law."""
        constant = self.intercept_db + self.frequency_slope_db * log10_frequency_ghz
        return np.asarray(constant + self.distance_slope_db * log10_distance_m)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A propagation scenario.

    Parameters
    ----------
    name : str
    los : Law
        For a clear link.
    nlos : tuple of Law
        Further lower bounds for a blocked link; the `los` law always bounds it too.
    sigma_los_db, sigma_nlos_db : float
        Standard deviation of the shadow fading [dB].
    distance_m : (float, float)
        Range of 3D distances for which the laws hold [m].
    frequency_hz : (float, float)
        Range of frequencies for which the laws hold [Hz].
    """

    name: str
    los: Law
    nlos: tuple[Law, ...]
    sigma_los_db: float
    sigma_nlos_db: float
    distance_m: tuple[float, float]
    frequency_hz: tuple[float, float] = (0.5e9, 100e9)


_INF_LOS = Law(31.84, 21.50, 19.00)
"""Rows of TR 38.901 (V19), table 7.4.1-1, InF: constant, slope and frequency term [dB]."""
_INF_SL = Law(33.00, 25.5, 20.0)
"""Row InF-SL of table 7.4.1-1."""
_INF_DL = Law(18.60, 35.7, 20.0)
"""Row InF-DL of table 7.4.1-1."""
_INF_SH = Law(32.40, 23.0, 20.0)
"""Row InF-SH of table 7.4.1-1."""
_INF_DH = Law(33.63, 21.9, 20.0)
"""Row InF-DH of table 7.4.1-1."""
_INF_M = (1.0, 600.0)
"""Distances that the InF rows hold for [m], table 7.4.1-1."""
_ANY = (0.0, math.inf)
"""Frequencies of free space, whose loss has no bounds (Friis)."""

SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario("InF-SL", _INF_LOS, (_INF_SL,), 4.3, 5.7, _INF_M),
        Scenario("InF-DL", _INF_LOS, (_INF_DL, _INF_SL), 4.3, 7.2, _INF_M),
        Scenario("InF-SH", _INF_LOS, (_INF_SH,), 4.3, 5.9, _INF_M),
        Scenario("InF-DH", _INF_LOS, (_INF_DH,), 4.3, 4.0, _INF_M),
        Scenario("InF-HH", _INF_LOS, (), 4.3, 4.3, _INF_M),
        Scenario("InH", Law(32.4, 17.3, 20.0), (Law(17.30, 38.3, 24.9),), 3.0, 8.03, (1.0, 150.0)),
        Scenario("free-space", Law(32.4, 20.0, 20.0), (), 0.0, 0.0, (0.01, math.inf), _ANY),
    )
}
"""TR 38.901 Tables 7.4.1-1; InF is the paper's family and InF-SH its scenario."""


def find_scenario(name: str) -> Scenario:
    """Return the scenario of that name.

    Raises
    ------
    BadInput
        When there is none; the message lists all and the nearest.
    """
    if name in SCENARIOS:
        return SCENARIOS[name]
    near = difflib.get_close_matches(name, SCENARIOS, n=1, cutoff=0.3)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise BadInput(f"no scenario {name!r} among {', '.join(SCENARIOS)}{hint}")


def path_loss_db(
    distance_m: ArrayLike, frequency_hz: float, line_of_sight: ArrayLike, scenario: str
) -> Floats:
    """Expected path loss (paper eq. (15)-(16); TR 38.901 Table 7.4.1-1).

    Closer than the scenario's shortest distance the loss is held at its value there; beyond its
    longest the law is extrapolated (`outside_range` tells where).

    Parameters
    ----------
    distance_m : (...) [m]
        **3D** distance between the antennas.
    frequency_hz : float [Hz]
    line_of_sight : (...) bool
        Broadcast against the distances.
    scenario : str
        A key of `SCENARIOS`.

    Returns
    -------
    (...) float64 [dB]

    Raises
    ------
    BadInput
        For an unknown scenario, or a frequency for which it does not hold.
    """
    chosen = find_scenario(scenario)
    log10_ghz = _log10_ghz(chosen, frequency_hz)
    log10_m = np.log10(np.maximum(np.asarray(distance_m, dtype=np.float64), chosen.distance_m[0]))
    los_db = chosen.los.loss_db(log10_m, log10_ghz)
    nlos_db = los_db
    for law in chosen.nlos:
        nlos_db = np.maximum(nlos_db, law.loss_db(log10_m, log10_ghz))
    return np.where(line_of_sight, los_db, nlos_db)


def _log10_ghz(scenario: Scenario, frequency_hz: float) -> float:
    low, high = scenario.frequency_hz
    if not (frequency_hz > 0.0 and low <= frequency_hz <= high):
        raise BadInput(
            f"{scenario.name} holds from {low * 1e-9:g} to {high * 1e-9:g} GHz,"
            f" not at {frequency_hz * 1e-9:g} GHz; scenario free-space holds everywhere"
        )
    return math.log10(frequency_hz * 1e-9)


def outside_range(distance_m: ArrayLike, scenario: str) -> Mask:
    """Tell which 3D distances (...) [m] lie outside the scenario's range."""
    low, high = find_scenario(scenario).distance_m
    distance = np.asarray(distance_m, dtype=np.float64)
    return np.asarray((distance < low) | (distance > high))


def shadow_sigma_db(line_of_sight: ArrayLike, scenario: str) -> Floats:
    """Standard deviation of the shadow fading (...) [dB]."""
    chosen = find_scenario(scenario)
    return np.where(line_of_sight, chosen.sigma_los_db, chosen.sigma_nlos_db)


def smallest_blocking_gap_db(frequency_hz: float, scenario: str, distances_m: ArrayLike) -> float:
    """Smallest excess loss of NLoS over LoS at these 3D distances [dB].

    A tolerance at or above it cannot distinguish a blocked from a clear link.
    """
    blocked = path_loss_db(distances_m, frequency_hz, False, scenario)
    return float(np.min(blocked - path_loss_db(distances_m, frequency_hz, True, scenario)))


@dataclass(frozen=True, slots=True)
class Clutter:
    """The clutter of an InF hall (TR 38.901 Table 7.2-4).

    Parameters
    ----------
    size_m : float
        Typical size; 10 m where sparse, 2 m where dense.
    density : float
        Share of the floor that is covered, 0 to 1.
    height_m : float
        Effective height, for the scenarios with a high base station.
    """

    size_m: float
    density: float
    height_m: float = 0.0


def los_probability(
    distance_2d_m: ArrayLike,
    scenario: str,
    clutter: Clutter,
    *,
    base_height_m: float,
    antenna_height_m: float,
) -> Floats:
    """Probability of a clear InF link (TR 38.901 Table 7.4.2-1).

    Parameters
    ----------
    distance_2d_m : (...) [m]
        **Plan** distance.
    scenario : str
        One of the InF family.
    clutter : Clutter
    base_height_m, antenna_height_m : float [m]

    Raises
    ------
    BadInput
        For a scenario without such a formula.
    """
    distance = np.asarray(distance_2d_m, dtype=np.float64)
    if scenario == "InF-HH":
        return np.ones_like(distance)
    if not find_scenario(scenario).name.startswith("InF-"):
        raise BadInput(f"{scenario} has no line-of-sight probability from clutter; use InF-*")
    reach_m = -clutter.size_m / math.log1p(-clutter.density)
    if scenario in ("InF-SH", "InF-DH"):
        reach_m *= (base_height_m - antenna_height_m) / (clutter.height_m - antenna_height_m)
    return np.exp(-distance / reach_m)


def los_probability_office(distance_2d_m: ArrayLike, *, is_open: bool) -> Floats:
    """Probability of a clear link in an indoor office (TR 38.901 Table 7.4.2-1).

    Parameters
    ----------
    distance_2d_m : (...) [m]
        **Plan** distance.
    is_open : bool
        Open office rather than mixed office.
    """
    near, near_reach, far, far_reach, share = (
        (5.0, 70.8, 49.0, 211.7, 0.54) if is_open else (1.2, 4.7, 6.5, 32.6, 0.32)
    )
    d = np.asarray(distance_2d_m, dtype=np.float64)
    falling = np.exp(-np.maximum(d - near, 0.0) / near_reach)
    tail = share * np.exp(-np.maximum(d - far, 0.0) / far_reach)
    # The table closes the first branch at 49 m for the open office, and opens it at 6.5 m else.
    return np.where(d <= far if is_open else d < far, falling, tail)
