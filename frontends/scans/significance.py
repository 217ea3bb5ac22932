# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bars of the tests of poses, fits and loop closures: quantiles and log odds."""

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
DECISIVE_NAT: Final = 5.0
"""Log odds from which walls and free space decide about a match, or about loop closures: 150 to 1.
For matches of submaps nothing moves by more than 1 % from 1 to 5; with 10 fewer true closures of
sparse recordings pass, with 20 fewer of a hall of pillars seen 5.6 m deep (0.26, 0.41 and 0.28 m in
place of 0.16, 0.25 and 0.14), with or without a bar of the score. Of contested closures, without
such a bar, one of six draws of edmonton is 0.99 m in place of 0.76, one ward 0.027 in place of
0.020, one hall 0.066 in place of 0.077; a dozen others stay."""
