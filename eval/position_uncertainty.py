# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How far off a run takes its own positions to be."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.eval.metrics import Metric
from slarm_graph.geometry import Floats

CHI_95 = math.sqrt(5.991)
"""Half axis, in standard deviations, of the ellipse that holds 95 % of a normal distribution."""


def uncertainty_metrics(covariances: Floats | None) -> tuple[Metric, ...]:
    """Return the longest half axis of the positions' 95 % ellipses; nothing if it is unknown.

    Parameters
    ----------
    covariances : (N, 3, 3) float64 or None
        Of the poses, as seen from the first one [m, m, rad].
    """
    if covariances is None or not len(covariances):
        return ()
    variances_m2 = np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1]
    worst_m = CHI_95 * math.sqrt(max(float(variances_m2.max()), 0.0))
    return (Metric("position_uncertainty_m", worst_m, note="95 % ellipse of the least sure pose"),)
