# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A world being driven through, watched: what was read of it, as a source is read."""

from __future__ import annotations

from collections.abc import Iterator

from slarm_graph.app.intake import Intake
from slarm_graph.app.progress import Progress
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading, ScanStatus, SourceInfo
from slarm_graph.world import DriveCommand, World


class DrivenWorld:
    """Passes everything on to a world and keeps count of what it says.

    Parameters
    ----------
    world : World
    description : str
        In words for people.
    progress : Progress
    """

    def __init__(self, world: World, description: str, progress: Progress) -> None:
        self._world, self._description, self._progress = world, description, progress
        self.intake = Intake()

    def read(self) -> Reading:
        """Return the sensor reading at the present instant."""
        reading = self._world.read()
        self.intake.note(reading)
        self._progress.advance()
        return reading

    def drive(self, command: DriveCommand) -> None:
        """Let time pass until the next reading is due while holding the command."""
        self._world.drive(command)

    def truth(self) -> Pose2:
        """Return `world_from_robot` at the present instant."""
        return self._world.truth()

    def collisions(self) -> int:
        """Return how often the body has touched a solid so far."""
        return self._world.collisions()

    def info(self) -> SourceInfo:
        """Describe the world."""
        return SourceInfo(self._description, len(self.intake.stamps_ns))

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        """Return every scan: all were used."""
        return tuple(ScanStatus(stamp_ns) for stamp_ns in self.intake.stamps_ns)

    def __iter__(self) -> Iterator[Reading]:
        """Yield nothing: a drive cannot be repeated."""
        return iter(())
