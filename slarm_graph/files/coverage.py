# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The geographic map's layers as `coverage.npz`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.files.arrays import arrays_of
from slarm_graph.files.npz import InParts, write_npz
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry, Scalar
from slarm_graph.raster.bands import in_runs


def write_coverage(path: Path, geographic: GeographicMap) -> None:
    """Write states, heights and the three coverage layers, all (rows, cols) with row 0 lowest."""
    g, coverage = geographic.geometry, geographic.coverage
    write_npz(
        path,
        (
            ("states", _in_parts(geographic.states, geographic)),
            ("state_names", np.array([state.name.lower() for state in CellState])),
            ("heights_m", _in_parts(geographic.heights_m, geographic)),
            ("height_source", np.array(geographic.height_source)),
            ("observed", _in_parts(coverage.observed, geographic)),
            ("visited", _in_parts(coverage.visited, geographic)),
            ("footprint", _in_parts(coverage.footprint, geographic)),
            ("changed_cells", geographic.changed_cells),
            ("expansion_radius_m", geographic.expansion_radius_m),
            ("resolution_m", g.resolution_m),
            ("origin_m", np.array([g.origin_x_m, g.origin_y_m])),
        ),
    )


def _in_parts(layer: NDArray[Scalar], geographic: GeographicMap) -> InParts:
    """Yield a layer in bands of rows; only known tiles are read."""
    return InParts(layer.shape, layer.dtype, in_runs(layer, geographic.where))


def read_coverage(path: Path) -> GeographicMap:
    """Read what `write_coverage` wrote; the map's solids are not stored.

    Raises
    ------
    BadInput
        When the file is missing or not of that kind.
    """
    with arrays_of(path, "a coverage file") as file:
        x_m, y_m = (float(v) for v in file["origin_m"])
        states = file["states"]
        layers = [np.asarray(file[name], np.bool_) for name in ("observed", "visited", "footprint")]
        heights_m = np.asarray(file["heights_m"], np.float32)
        if states.ndim != 2 or any(layer.shape != states.shape for layer in (heights_m, *layers)):
            raise ValueError("layers of different shapes")
        return GeographicMap(
            GridGeometry(x_m, y_m, float(file["resolution_m"]), *states.shape),
            states,
            heights_m,
            str(file["height_source"]),
            Coverage(*layers),
            int(file["changed_cells"]),
            expansion_radius_m=float(file.get("expansion_radius_m", 0.0)),
        )
