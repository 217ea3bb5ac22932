# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Explorers by name; built when asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from slarm_graph import parts

if TYPE_CHECKING:
    from slarm_graph.config import RunConfig
    from slarm_graph.exploration.explorer import Explorer


def make(config: RunConfig) -> Explorer:
    """Build the explorer that `config.explore.explorer` names.

    Raises
    ------
    BadInput
        When there is no such explorer, or something it needs is not installed.
    """
    explore = config.explore
    explorer: Explorer = parts.make("explorer", explore.explorer, config, explore.driving)
    return explorer
