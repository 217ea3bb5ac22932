# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Quantiles of the significance tests (gates) of poses and fits."""

from __future__ import annotations

from typing import Final

CHI2_1_PERCENT: Final = 11.34
"""Chi-square quantile of 0.99 for 3 degrees of freedom: gate on squared Mahalanobis distances."""
CHI2_1_PERMILLE: Final = 16.27
"""The same quantile of 0.999, one in a thousand."""
SIGMAS_1_PERCENT: Final = 2.33
"""One-sided normal quantile of 0.99, in standard deviations. Of rough walls some points
fit less a step further on, others more: with 1.0 there, three simulated buildings are 0.29, 0.07
and 0.09 in place of 0.42, 0.03 and 0.04."""
