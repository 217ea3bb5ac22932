# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A command of one's own: `slarm length runs/latest/trajectory.tum`."""

from __future__ import annotations

from pathlib import Path


def length(trajectory: Path) -> None:
    """Print the length of a path in metres."""
    from slarm_graph import read_trajectory  # what is heavy is imported when it is needed

    print(f"{read_trajectory(trajectory).path_length_m():.3f}")
