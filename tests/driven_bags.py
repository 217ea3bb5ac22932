# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A short drive as a recording of any kind, and what opening it gives or tells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ros_bags import Recorded, maker_of

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.readings import Reading, Source

T0 = 1000.0
NONE = SourceConfig(odom="none")


def drive(
    kind: str = "bag",
    *,
    scans: int = 40,
    odom: bool = True,
    until_s: float = 1e9,
    laser: str = "base_link",
    seed: int = 0,
    **scan: object,
) -> list[Recorded]:
    """A robot that drives along x at 1 m/s, scanning at 10 Hz."""
    make, rng = maker_of(kind), np.random.default_rng(seed)
    messages: list[Recorded] = []
    for k in range(scans):
        t = T0 + 0.1 * k
        ranges = 2.0 + rng.random(60)
        messages.append(("/scan", t, make.laser_scan(t, ranges, frame=laser, **scan)))
        if odom and t - T0 <= until_s:
            messages.append(("/odom", t, make.odom(t - 0.02, x=t - 0.02 - T0)))
    return messages


def opened(path: Path | list[Path], config: SourceConfig | None = None) -> Source:
    return open_source(path, config or SourceConfig())


def readings(path: Path | list[Path], config: SourceConfig | None = None) -> list[Reading]:
    return list(opened(path, config))


def told(path: Path | list[Path], config: SourceConfig | None = None) -> str:
    """The one line that refuses a recording."""
    with pytest.raises(BadInput) as caught:
        opened(path, config)
    text = str(caught.value)
    assert "\n" not in text
    return text


def noticed(path: Path, config: SourceConfig | None = None) -> str:
    return "; ".join(opened(path, config).info().notices)
