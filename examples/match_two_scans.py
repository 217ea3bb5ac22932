# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lay one scan of a recording onto another, by every matcher.

python examples/match_two_scans.py your.bag 0 10
"""

import sys

import numpy as np

from slarm_graph import match_scans, open_source


def main(recording: str, target: str = "0", source: str = "1") -> None:
    """Print where the source's robot stood, seen from the target's."""
    scans = [reading.scan for reading in open_source(recording)]
    for matcher in ("likelihood", "icp", "correlative"):
        match = match_scans(scans[int(source)], scans[int(target)], matcher=matcher)
        if not match:
            print(f"{matcher}: failed, {match.reason}")
            continue
        x, y, theta = match.target_from_source.as_array()
        sigma_mm = 1e3 * np.sqrt(np.diag(match.covariance)[:2].max())
        print(f"{matcher}: {x:.3f} m, {y:.3f} m, {theta:.4f} rad, +- {sigma_mm:.1f} mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
