# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Results to numbers and pages: trajectory, map and radio metrics, reports.

The metrics that come along are the rows of `eval/metric_kinds.csv`; those of others are
classes with what `slarm_graph.eval.metric_parts.MetricPart` says, built without arguments.
"""

BUILT_IN: dict[str, str] = {}
