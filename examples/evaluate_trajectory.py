# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure an estimated trajectory against a true one: TUM, KITTI or EuRoC files.

python examples/evaluate_trajectory.py truth.tum estimate.tum
"""

import sys
from pathlib import Path

from slarm_graph import References, Subject, assess, read_trajectory


def main(truth: str, estimate: str) -> None:
    """Print every metric that a trajectory and its truth allow."""
    references = References(ground_truth=read_trajectory(Path(truth)))
    for metric in assess(Subject(read_trajectory(Path(estimate)), references)):
        print(f"{metric.kind.title}: {metric.value:.4f} {metric.unit} ({metric.note})")


if __name__ == "__main__":
    main(*sys.argv[1:])
