# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is too far off for chance: the quantiles that all tests of poses and fits share."""

from __future__ import annotations

from typing import Final

CHI2_1_PERCENT: Final = 11.34
"""Squared Mahalanobis length that one pose in a hundred exceeds: chi-square of 3 numbers."""
CHI2_1_PERMILLE: Final = 16.27
"""The same of one in a thousand."""
SIGMAS_1_PERCENT: Final = 2.33
"""Standard deviations to one side that one number in a hundred exceeds. Of rough walls some points
fit less a step further on, others more: with 1.0 there, three simulated buildings are 0.29, 0.07
and 0.09 in place of 0.42, 0.03 and 0.04."""
