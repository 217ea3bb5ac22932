# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The application around the core: the flow, run folders, comparisons, the command line.

A command is a function for typer, with its help as docstring, or a `typer.Typer` of several. All
are loaded whenever `slarm` starts: heavy modules are imported inside the functions.
"""

BUILT_IN = {
    "run": "slarm_graph.app.cli_run:run_command",
    "explore": "slarm_graph.app.cli_run:explore_command",
    "compare": "slarm_graph.app.cli_compare:compare_command",
    "demo": "slarm_graph.app.cli_compare:demo_command",
    "reproduce": "slarm_graph.app.cli_reproduce:reproduce_command",
    "eval": "slarm_graph.app.cli_eval:group",
    "radio": "slarm_graph.app.cli_radio:radio_command",
    "check": "slarm_graph.app.cli_tools:check_command",
    "convert": "slarm_graph.app.cli_tools:convert_command",
    "export": "slarm_graph.app.cli_tools:export_command",
    "worlds": "slarm_graph.app.cli_tools:worlds_command",
    "config": "slarm_graph.app.cli_tools:config_command",
    "backends": "slarm_graph.app.cli_tools:backends_command",
    "doctor": "slarm_graph.app.cli_tools:doctor_command",
}
