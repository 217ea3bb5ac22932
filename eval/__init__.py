# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Results to numbers and pages: trajectory, map and radio metrics, reports.

The metrics of this package are the rows of `eval/metric_kinds.csv`; those of other packages are
classes that implement `slarm_graph.eval.metric_parts.MetricPart`, built without arguments.
"""

BUILT_IN: dict[str, str] = {}
