# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Exploration: GGMR, baselines, path planning, path following, and the closed loop.

An explorer is a class with the method of `slarm_graph.exploration.explorer.Explorer`, the attribute
`settings` (a `slarm_graph.config.Stage`) and the constructor `(settings, driving: DrivingConfig)`.
"""

BUILT_IN = {
    "ggmr": "slarm_graph.exploration.ggmr:Ggmr",
    "ggmr+": "slarm_graph.exploration.ggmr_plus:GgmrPlus",
    "ba*": "slarm_graph.exploration.baselines:BaStar",
    "boustrophedon": "slarm_graph.exploration.baselines:Boustrophedon",
    "frontier": "slarm_graph.exploration.frontier:NearestFrontier",
    "radio-survey": "slarm_graph.exploration.radio_survey:RadioSurvey",
}
