# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Memory of a backend by time driven: a recording there and back again, for hours.

    python benchmarks/soak.py intel.clf.gz --times 11 --backend pose_graph --chart soak.svg

Every other pass goes through the recording backwards, so that the path goes on where it was. The
scans of a pass are those of the first one, so that what grows is the backend's. With the area
mapped after the first pass, memory should not grow any more.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from slarm_graph import backends
from slarm_graph.app.allocation import configure_allocator, return_freed
from slarm_graph.app.ending import memory_mb
from slarm_graph.backend import silent
from slarm_graph.config import RunConfig
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.readings import Reading


@dataclass(frozen=True, slots=True)
class Point:
    """What is measured after a part of the drive."""

    driven_h: float
    memory_mb: float
    cpu_s: float
    scans: int


def there_and_back(readings: Sequence[Reading], times: int) -> Iterator[Reading]:
    """Go through readings forward, backward, forward ..., with stamps that go on."""
    first_ns, last_ns = readings[0].stamp_ns, readings[-1].stamp_ns
    step_ns = (last_ns - first_ns) // max(len(readings) - 1, 1)
    begun_ns = first_ns
    for number in range(times):
        backward = number % 2 == 1
        for reading in reversed(readings) if backward else readings:
            into_ns = last_ns - reading.stamp_ns if backward else reading.stamp_ns - first_ns
            yield replace(reading, stamp_ns=begun_ns + into_ns)
        begun_ns += last_ns - first_ns + step_ns


def measured(readings: Sequence[Reading], times: int, backend_name: str) -> Iterator[Point]:
    """Feed a backend and measure a tenth of a pass apart."""
    config = RunConfig(backend=backend_name)
    backend = backends.make(config.backend, config, np.random.default_rng(0), silent)
    begun_s, every = time.process_time(), max(len(readings) // 10, 1)
    first_ns = readings[0].stamp_ns
    for count, reading in enumerate(there_and_back(readings, times), 1):
        backend.update(reading)
        if count % every == 0:
            hours = (reading.stamp_ns - first_ns) * 1e-9 / 3600.0
            spent_s = time.process_time() - begun_s
            yield Point(hours, resident_mb(), spent_s, count)


def resident_mb() -> float:
    """Memory of this process [MB], without what is free for it to use again."""
    gc.collect()
    return_freed()
    return memory_mb()


def draw(points: Sequence[Point], title: str, path: Path) -> None:
    """Draw memory by time driven."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([p.driven_h for p in points], [p.memory_mb for p in points])
    axes.set(xlabel="driven [h]", ylabel="memory [MB]", ylim=(0.0, None), title=title)
    figure.savefig(path)


def main() -> None:
    """Measure, print one line per pass, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--times", type=int, default=11)
    parser.add_argument("--backend", default="pose_graph")
    parser.add_argument("--chart", type=Path)
    given = parser.parse_args()
    configure_allocator()
    readings = list(open_source(given.recording))
    print("| driven [h] | scans | memory [MB] | CPU [s] |\n|---|---|---|---|")
    points = []
    for point in measured(readings, given.times, given.backend):
        points.append(point)
        if len(points) % 10 == 0:
            figures = f"{point.memory_mb:.0f} | {point.cpu_s:.0f}"
            print(f"| {point.driven_h:.2f} | {point.scans} | {figures} |", flush=True)
    if given.chart is not None:
        draw(points, f"{given.recording.name}, {given.backend}", given.chart)


if __name__ == "__main__":
    main()
