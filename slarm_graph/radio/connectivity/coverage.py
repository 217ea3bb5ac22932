# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio coverage of the floor: per access point, and by the best server."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from slarm_graph.radio.connectivity.signal import PERCENTILES, Connection, SignalMap

TOGETHER = "all together"
"""Name of the row of the best server."""


def connections(signal: SignalMap, threshold_dbm: float) -> tuple[Connection, ...]:
    """Return the coverage of each access point, and by the best server where there are several.

    Parameters
    ----------
    signal : SignalMap
    threshold_dbm : float
    """
    alone = [
        replace(
            signal, names=(name,), level_dbm=signal.level_dbm[[i]], spread_db=signal.spread_db[[i]]
        )
        for i, name in enumerate(signal.names)
    ]
    each = tuple(_connection(one, one.names[0], threshold_dbm) for one in alone)
    if len(each) < 2:
        return each
    return (*each, _connection(signal, TOGETHER, threshold_dbm))


def _connection(signal: SignalMap, name: str, threshold_dbm: float) -> Connection:
    floor, covered = signal.cells, signal.covered(threshold_dbm)
    patches, _ = ndimage.label(covered)
    largest = int(np.bincount(patches.ravel())[1:].max(initial=0))
    cells, count = max(int(floor.sum()), 1), int(covered.sum())
    outage = float(np.nanmean(signal.outage(threshold_dbm))) if floor.any() else 1.0
    known = signal.best_level_dbm()[floor]
    points = np.percentile(known, PERCENTILES) if len(known) else np.full(len(PERCENTILES), np.nan)
    return Connection(
        name,
        count * signal.geometry.resolution_m**2,
        count / cells,
        largest / cells,
        outage,
        tuple(float(p) for p in points),
    )
