# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Signs, limits and denominators that a slip of the pen would change without a trace."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slarm_graph.backend import SlamResult
from slarm_graph.config import DrivingConfig, ExploreConfig
from slarm_graph.constraint import ConstraintKind
from slarm_graph.errors import BadInput
from slarm_graph.eval.map_accuracy import map_accuracy
from slarm_graph.eval.relations import Relations, relation_errors
from slarm_graph.exploration.closed_loop import ClosedLoop
from slarm_graph.exploration.live_map import LiveMap, _forbidden
from slarm_graph.exploration.survey import position_rmse_m
from slarm_graph.files.g2o import read_g2o
from slarm_graph.files.maps import read_map
from slarm_graph.frontends.recordings.rotations import quaternion_of, yaws
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory


def test_the_rough_boundary_shrinks_by_half_the_rmse_on_each_side():
    geometry = GridGeometry(-1.0, -1.0, 0.1, 30, 40)
    out = _forbidden(geometry, (-1.0, 3.0, -1.0, 2.0), ExploreConfig(), 0.4)
    x, y = np.moveaxis(geometry.centers(), -1, 0)
    inside = (x > -0.8) & (x < 2.8) & (y > -0.8) & (y < 1.8)
    np.testing.assert_array_equal(out, ~inside)
    assert not _forbidden(geometry, (-1.0, 3.0, -1.0, 2.0), ExploreConfig(), 0.0).any()


def test_the_error_of_positions_is_the_slam_stages_own():
    path = Trajectory(np.arange(2), np.zeros((2, 3)))
    covariances = np.stack([np.diag([0.01, 0.03, 9.0]), np.diag([0.02, 0.06, 9.0])])
    assert position_rmse_m(SlamResult(path, covariances=covariances)) == pytest.approx(0.06**0.5)
    assert position_rmse_m(SlamResult(path)) == 0.0


def test_planning_keeps_the_margin_beyond_half_a_cell():
    driving = DrivingConfig(robot_radius_m=0.2, margin_m=0.03)
    live = SimpleNamespace(
        config=ExploreConfig(driving=driving),
        driving_geometry=GridGeometry(0.0, 0.0, 0.04, 5, 5),
    )
    live._least_m = lambda: LiveMap._least_m(live)
    assert LiveMap._least_m(live) == pytest.approx(0.22)
    assert LiveMap._needed_m(live) == pytest.approx(0.25)


def test_a_new_leg_is_asked_for_before_the_brakes_bite():
    driving = DrivingConfig(speed_m_s=0.8, acceleration_m_s2=0.5)
    loop = SimpleNamespace(
        _config=ExploreConfig(driving=driving), _survey=SimpleNamespace(dt_s=0.1)
    )
    assert ClosedLoop._braking_m(loop) == pytest.approx(0.64 + 0.16)


def test_relations_up_to_half_a_second_outside_count():
    path = Trajectory(np.array([0, 10_000_000_000]), np.zeros((2, 3)))
    for beyond_ns, used in ((499_000_000, 2), (500_000_000, 2), (501_000_000, 1)):
        stamps = np.array([[1_000_000_000, 2_000_000_000], [3_000_000_000, 10_000_000_000]])
        stamps[1, 1] += beyond_ns
        errors = relation_errors(Relations(stamps, np.zeros((2, 3))), path)
        assert (len(errors.translation_m), errors.total) == (used, 2)
    with pytest.raises(BadInput):
        relation_errors(Relations(stamps[1:], np.zeros((1, 3))), path)


@pytest.mark.parametrize("seed", range(4))
def test_heading_of_a_tilted_robot_is_that_of_its_nose(seed):
    """Where the x axis points seen from above, by rotating it."""
    yaw, pitch, roll = np.random.default_rng(seed).uniform(-1.2, 1.2, 3)
    q = quaternion_of(yaw, pitch, roll)
    nose = Rotation.from_quat(q).apply([1.0, 0.0, 0.0])
    assert yaws(q[None])[0] == pytest.approx(math.atan2(nose[1], nose[0]))
    assert yaws(q[None])[0] == pytest.approx(yaw)


@pytest.mark.parametrize(("shade", "is_free"), [(204, True), (203, False)])
def test_a_shade_at_the_free_threshold_is_free(shade, is_free, tmp_path):
    """P = (255 - 204) / 255 = 0.2 exactly."""
    image = np.full((2, 2), shade, dtype=np.uint8)
    image[0, 0] = 0
    (tmp_path / "m.pgm").write_bytes(b"P5\n2 2\n255\n" + image.tobytes())
    (tmp_path / "m.yaml").write_text(
        "image: m.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    assert read_map(tmp_path / "m.yaml").free[0, 1] == is_free


def grid(rows):
    values = np.array([[{"#": 1.0, ".": 0.0, "?": np.nan}[c] for c in row] for row in rows])
    return OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, *values.shape), values.astype(np.float32))


def test_recall_is_over_the_walls_that_were_mapped():
    """A wall in an unknown part is not missed, one that the map has as free is."""
    reference = grid(["########", "........", "########"])
    estimate = grid(["####....", "........", "????????"])
    score = map_accuracy(reference, estimate, tolerance_m=0.05)
    assert score.recall == 0.5
    assert score.precision == 1.0
    assert score.known_share == pytest.approx(2 / 3)


def test_backward_edges_keep_their_direction(tmp_path):
    path = tmp_path / "graph.g2o"
    vertices = "".join(f"VERTEX_SE2 {n} {n} 0 0\n" for n in range(3))
    path.write_text(
        vertices
        + "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 2 1 -1 0.5 0.25 4 0 0 4 0 9\n"
        + "EDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n"
    )
    backward = read_g2o(path).graph.constraints[1]
    assert (backward.i, backward.j, backward.kind) == (2, 1, ConstraintKind.LOOP_CLOSURE)
    pose = backward.i_from_j
    assert (pose.x, pose.y, pose.theta) == (-1.0, 0.5, 0.25)
    np.testing.assert_allclose(np.diag(backward.covariance), [0.25, 0.25, 1.0 / 9.0])
