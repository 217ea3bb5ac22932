# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Run a backend over a recording, and write its trajectory and map.

python examples/run_bag.py your.bag OUT [BACKEND]
"""

import sys
from pathlib import Path

from slarm_graph import (
    MappingConfig,
    open_source,
    render,
    run_backend,
    write_map,
    write_trajectory,
)


def main(recording: str, out: str, backend: str = "pose_graph") -> None:
    """Read, localize, draw, write."""
    source = open_source(recording)
    readings = list(source)
    slam = run_backend(readings, backend)
    grid = render([reading.scan for reading in readings], slam.trajectory, MappingConfig())
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    write_trajectory(folder / "trajectory.tum", slam.trajectory)
    write_map(folder / "map.yaml", grid)
    print(f"{len(readings)} scans, {slam.trajectory.path_length_m():.2f} m -> {folder}")


if __name__ == "__main__":
    main(*sys.argv[1:])
