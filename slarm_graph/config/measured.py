# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of radio maps from measured signal strength."""

from __future__ import annotations

from pydantic import Field

from slarm_graph.config.stage import Stage


class MeasuredConfig(Stage):
    """Radio maps from measured signal strength."""

    node_side_m: float = Field(default=0.2, gt=0)
    """Side of the pieces of floor on which the field is kept; well below the shadowing's range."""
    most_nodes: int = Field(default=20_000, ge=10)
    """The pieces grow where there would be more of them: this bounds memory and time."""
    threshold_dbm: float | None = None
    """Signals weaker than this are not heard; null: the weakest that was."""
    saturation_dbm: float | None = None
    """The receiver tells nothing stronger; null: it has no such limit."""
    position_sd_m: float = Field(default=0.05, ge=0)
    """How sure the trajectory's positions are, along each axis."""
    least_readings: int = Field(default=10, ge=3)
    """Access points heard less often are left out, with a notice."""
    locate: bool = True
    """Whether access points of unknown position are sought by what was heard."""
    heights: bool = True
    """Whether heights that nobody has said are told by what is heard behind obstacles, of access
    points whose position is known."""
    search_readings: int = Field(default=3_000, ge=100)
    """Ranges and noises are searched on so many readings; all count for the map."""
    search_nodes: int = Field(default=2_500, ge=10)
    """And on so many pieces of floor."""
