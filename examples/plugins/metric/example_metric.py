# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A metric of one's own: it stands in every table and report from now on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from slarm_graph import Metric, MetricKind, Subject


class LoopGap:
    """How far the end of the path is from its beginning."""

    kinds = (
        MetricKind(
            "loop_gap_m", "m", "gap between start and end", "", "always", "distance of the two"
        ),
    )

    def measure(self, subject: Subject) -> Iterable[Metric]:
        """Measure a run."""
        first, last = subject.trajectory.poses[[0, -1], :2]
        yield Metric("loop_gap_m", float(np.hypot(*(last - first))))
