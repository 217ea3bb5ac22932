# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Path loss, line of sight and fading: the radio map and its files.

A propagation model is a class with the method of
`slarm_graph.radio.propagation.links.PropagationModel`, the attribute `settings` (a
`slarm_graph.config.Stage`) and the constructor `(settings, radio: RadioConfig)`.
"""

BUILT_IN = {
    "3gpp": "slarm_graph.radio.propagation.models:ScenarioModel",
    "log-distance": "slarm_graph.radio.propagation.models:LogDistance",
    "multi-wall": "slarm_graph.radio.propagation.models:MultiWall",
}
