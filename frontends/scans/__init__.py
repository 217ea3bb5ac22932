# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The shared scan frontend: filters, matchers, tracking, submaps, loop closure.

A matcher is a class with the method of `slarm_graph.frontends.scans.matcher.ScanMatcher`, the
attribute `settings` (a `slarm_graph.config.Stage`) and the constructor
`(settings, matching: MatchingConfig)`.
"""

BUILT_IN = {
    "likelihood": "slarm_graph.frontends.scans.matcher:LikelihoodMatcher",
    "icp": "slarm_graph.frontends.scans.matcher:IcpMatcher",
    "correlative": "slarm_graph.frontends.scans.matcher:CorrelativeMatcher",
}
