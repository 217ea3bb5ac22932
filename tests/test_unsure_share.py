# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A trajectory that nothing contradicts, but that is unsure by its own covariances."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.app.consistency_check import check_slam, check_trajectory
from slarm_graph.app.pipeline import check_consistency
from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.backend import SlamResult
from slarm_graph.consistency.verdict import unsure_share
from slarm_graph.constraint import PoseGraph
from slarm_graph.files.consistency import consistency_json
from slarm_graph.geometry import Pose2
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.trajectory import Trajectory


@pytest.fixture(scope="module")
def there_and_back() -> tuple[ReadingLog, Trajectory]:
    """Up and down a corridor of 3 m, three times, seen without an error."""
    poses = [Pose2(x, 0.0, 0.0) for x in [*np.arange(0.0, 20.0, 0.5), *np.arange(20.0, 0.0, -0.5)]]
    log, angles = ReadingLog(), np.linspace(-np.pi, np.pi, 120, endpoint=False)
    for k, pose in enumerate(poses * 3):
        along = np.where(np.cos(angles) > 0.0, 30.0 - pose.x, 10.0 + pose.x)
        with np.errstate(divide="ignore"):
            ranges = np.minimum(1.5 / np.abs(np.sin(angles)), along / np.abs(np.cos(angles)))
        scan = LaserScan(ranges, angles[0], angles[1] - angles[0], 0.1, 60.0)
        log.append(Reading((k + 1) * 100_000_000, scan, pose))
    return log, Trajectory(log.stamps_ns, np.array([p.as_array() for p in poses * 3]))


def test_the_share_is_that_of_normal_errors() -> None:
    """Against draws; a pose that is sure has none, and two count for half each."""
    rng = np.random.default_rng(5)
    for sd_m in (0.1, 0.2, 0.35, 1.0):
        off = np.hypot(*rng.normal(0.0, sd_m, (2, 200_000))) > 0.5
        assert unsure_share(np.full(3, sd_m)) == pytest.approx(off.mean(), abs=0.004)
    assert unsure_share(np.array([0.0, 1e-300, 1e-9])) == 0.0
    assert unsure_share(np.array([0.0, 1e6])) == pytest.approx(0.5)
    assert math.isnan(unsure_share(None)) and math.isnan(unsure_share(np.zeros(0)))


def slam_of(trajectory: Trajectory, sd_m: float) -> SlamResult:
    """A graph's result that is so unsure along an axis; 1.4 times along one, 0 along the other."""
    covariances = np.tile(np.diag([2.0 * sd_m**2, 0.0, 1e-4]), (len(trajectory), 1, 1))
    return SlamResult(trajectory, covariances, PoseGraph(trajectory.poses[:1], ()))


# One pose in a hundred is off by half a metre at 0.1648 m along an axis.
@pytest.mark.parametrize(("sd_m", "verdict"), [(0.164, "consistent"), (0.166, "doubtful")])
def test_who_expects_to_be_lost_is_doubtful(
    there_and_back: tuple[ReadingLog, Trajectory], sd_m: float, verdict: str
) -> None:
    log, trajectory = there_and_back
    result = check_slam(log, slam_of(trajectory, sd_m))
    assert result.verdict == verdict
    told = "1% of the way is expected to be more than 0.5 m off"
    assert any(told in reason for reason in result.reasons) == (verdict == "doubtful")


@pytest.mark.parametrize("what", ["no graph", "no covariances", "a trajectory alone"])
def test_what_is_not_known_is_no_doubt(
    there_and_back: tuple[ReadingLog, Trajectory], what: str
) -> None:
    log, trajectory = there_and_back
    slam = slam_of(trajectory, 0.5)
    result = {
        "no graph": lambda: check_slam(log, replace(slam, pose_graph=None)),
        "no covariances": lambda: check_slam(log, replace(slam, covariances=None)),
        "a trajectory alone": lambda: check_trajectory(log, trajectory),
    }[what]()
    assert (result.verdict, math.isnan(result.unsure_share)) == ("consistent", True)
    assert '"unsure_share": null' in consistency_json(result)


def test_a_runs_verdict_knows_its_covariances(
    there_and_back: tuple[ReadingLog, Trajectory], tmp_path: Path
) -> None:
    log, trajectory = there_and_back
    folder = create_run_folder(tmp_path, "run", overwrite=False, kind="run")
    result = check_consistency(log, slam_of(trajectory, 0.2), folder, Quiet())
    assert result.verdict == "doubtful"
    assert result.unsure_share == pytest.approx(math.exp(-0.25 / 0.08))
    assert (
        f'"unsure_share": {result.unsure_share}' in (folder.path / "consistency.json").read_text()
    )
