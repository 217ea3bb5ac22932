# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""tf geometry against scipy's rotations, and lasers in every position a robot may carry them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from ros_bags import IDENTITY, maker_of, write_recording
from scipy.spatial.transform import Rotation, Slerp

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.messages import StampedTransforms
from slarm_graph.frontends.recordings.mounting import mounting_in_plane
from slarm_graph.frontends.recordings.rotations import (
    interpolate,
    matrices,
    quaternion_of,
    slerp,
    yaws,
)
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.recordings.transforms import TransformTree, parse_static

ANY_GAP = 10**18


def random_quaternions(rng: np.random.Generator, count: int) -> np.ndarray:
    return Rotation.random(count, rng=rng).as_quat()


def some_transforms(
    edges: list[tuple[str, str]], stamps: np.ndarray, rng: np.random.Generator
) -> StampedTransforms:
    """Every edge at every stamp, at random."""
    count = len(edges) * len(stamps)
    return StampedTransforms(
        np.tile(stamps, len(edges)),
        np.tile(stamps, len(edges)),
        tuple(edges),
        np.repeat(np.arange(len(edges)), len(stamps)),
        rng.normal(size=(count, 3)),
        random_quaternions(rng, count),
    )


def test_rotations_are_scipys() -> None:
    rng = np.random.default_rng(0)
    q = random_quaternions(rng, 200)
    np.testing.assert_allclose(matrices(q), Rotation.from_quat(q).as_matrix(), atol=1e-12)
    x_axis = Rotation.from_quat(q).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(yaws(q), np.arctan2(x_axis[:, 1], x_axis[:, 0]), atol=1e-12)
    yaw, pitch, roll = 0.3, -0.7, 2.9
    want = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
    np.testing.assert_allclose(quaternion_of(yaw, pitch, roll), want, atol=1e-12)


def test_slerp_is_scipys_also_the_short_way_round_and_between_equal_ends() -> None:
    rng = np.random.default_rng(1)
    start, end = random_quaternions(rng, 100), random_quaternions(rng, 100)
    end[:10] = start[:10]
    end[10:20] = -start[10:20]
    share = rng.random(100)
    got = Rotation.from_quat(slerp(start, end, share))
    for row in range(100):
        pair = Rotation.from_quat([start[row], end[row]])
        want = Slerp([0.0, 1.0], pair)(share[row])
        assert (got[row].inv() * want).magnitude() < 1e-7


def test_a_chain_of_moving_frames_is_scipys_at_any_instant() -> None:
    rng = np.random.default_rng(2)
    stamps = np.arange(20, dtype=np.int64) * 100_000_000
    edges = [("odom", "base"), ("base", "mast"), ("mast", "laser"), ("base", "arm")]
    parts = some_transforms(edges, stamps, rng)
    tree = TransformTree([parts])
    at = rng.integers(0, stamps[-1], size=50)
    turned, moved, known = tree.lookup("arm", "laser", at, ANY_GAP)
    assert known.all()

    def one(number: int, when: int) -> np.ndarray:
        rows = np.flatnonzero(parts.edge == number)
        turns = Slerp(stamps, Rotation.from_quat(parts.quaternions[rows]))(when)
        place = [np.interp(when, stamps, parts.translations_m[rows, axis]) for axis in range(3)]
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turns.as_matrix(), place
        return matrix

    for row, when in enumerate(at):
        want = np.linalg.inv(one(3, when)) @ one(1, when) @ one(2, when)
        np.testing.assert_allclose(turned[row], want[:3, :3], atol=1e-6)
        np.testing.assert_allclose(moved[row], want[:3, 3], atol=1e-6)


def test_what_never_changes_holds_for_all_time() -> None:
    stamps = np.arange(10, dtype=np.int64) * 10**9
    still = StampedTransforms(
        stamps, stamps, (("base", "laser"),), np.zeros(10, np.int64),
        np.tile([0.1, 0.2, 0.3], (10, 1)), np.tile(IDENTITY, (10, 1)),
    )  # fmt: skip
    _, moved, known = TransformTree([still]).lookup("base", "laser", np.array([-(10**15)]), 1)
    assert known.all()
    np.testing.assert_array_equal(moved, [[0.1, 0.2, 0.3]])


def test_no_bridging_of_long_silences_and_no_extrapolation() -> None:
    rng = np.random.default_rng(3)
    stamps = np.array([0, 100, 200, 300, 5000, 5100], np.int64) * 10**6
    moved, turned = rng.normal(size=(6, 3)), random_quaternions(rng, 6)
    at = np.array([-50, -5000, 150, 300, 2000, 5050, 5150, 9000]) * 10**6
    _, _, known = interpolate(stamps, moved, turned, at, 10**9)
    assert known.tolist() == [True, False, True, True, False, True, True, False]


def test_static_tf_from_the_command_line() -> None:
    part = parse_static(["/base laser 1 2 3 0.5", "base rear 0 0 0 0.1 0.2 3.1"])
    assert part.edges == (("base", "laser"), ("base", "rear"))
    want = Rotation.from_euler("ZYX", [0.1, 0.2, 3.1]).as_quat()
    np.testing.assert_allclose(part.quaternions[1], want, atol=1e-12)
    for bad in ("a b", "a b 1 2 3 x", "a b 1 2 3 4 5", "a b 1 2 3 nan"):
        with pytest.raises(BadInput, match="expected 'parent child x y z yaw"):
            parse_static([bad])


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("turned_over", [False, True])
def test_tilt_is_refused_beyond_five_degrees(axis: str, turned_over: bool) -> None:
    for tilt_deg, fine in ((4.9, True), (5.1, False), (14.2, False)):
        turn = Rotation.from_euler(axis, tilt_deg, degrees=True)
        if turned_over:
            turn = turn * Rotation.from_euler("x", 180.0, degrees=True)
        if fine:
            mounting = mounting_in_plane(turn.as_matrix(), np.zeros(3), "laser")
            assert mounting.tilt_deg == pytest.approx(tilt_deg)
            assert any("tilted" in line for line in mounting.describe("laser"))
            continue
        with pytest.raises(BadInput) as caught:
            mounting_in_plane(turn.as_matrix(), np.zeros(3), "laser")
        want = f"laser frame laser is tilted {tilt_deg:.1f} deg about {axis}; 2D needs < 5 deg"
        assert str(caught.value).startswith(want)


MOUNTS = {
    "ahead": Rotation.identity(),
    "rear": Rotation.from_euler("z", 180, degrees=True),
    "yawed": Rotation.from_euler("z", 37, degrees=True),
    "upside down": Rotation.from_euler("x", 180, degrees=True),
    "upside down about y": Rotation.from_euler("y", 180, degrees=True),
    "upside down and yawed": Rotation.from_euler("ZX", [-110, 180], degrees=True),
}


@pytest.mark.parametrize("mount", MOUNTS, ids=lambda name: name.replace(" ", "_"))
@pytest.mark.parametrize("step", [0.1, -0.1])
@pytest.mark.parametrize("start", [-1.5, 0.0, 3.0])
def test_points_are_where_full_3d_puts_them(
    tmp_path: Path, mount: str, step: float, start: float
) -> None:
    make, rng = maker_of("bag"), np.random.default_rng(4)
    turn, place = MOUNTS[mount], (0.25, -0.1, 0.4)
    ranges = (1.0 + 5.0 * rng.random(50)).astype(np.float32)
    scan = make.laser_scan(5.0, ranges, angles=(start, step))
    # Two edges, the second published on /tf long after the scan.
    half = Rotation.from_euler("z", 20, degrees=True)
    mast = ("base_link", "mast", place, tuple(half.as_quat()))
    laser = ("mast", "laser", (0.1, 0.0, 0.0), tuple((half.inv() * turn).as_quat()))
    messages = [
        ("/scan", 5.0, scan),
        ("/scan", 5.1, make.laser_scan(5.1, ranges[::-1], angles=(start, step))),
        ("/tf_static", 5.2, make.transforms(5.2, mast)),
        ("/tf", 9.0, make.transforms(9.0, laser)),
    ]
    path = write_recording(tmp_path / "a.bag", messages)
    got = next(iter(open_source(path, SourceConfig()))).scan.points_m()
    angles = np.float32(start) + np.float32(step) * np.arange(50)
    in_laser = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(50)])
    want = turn.apply(in_laser) + half.apply([0.1, 0.0, 0.0]) + place
    np.testing.assert_allclose(got, want[:, :2], atol=1e-5)


def test_a_mast_that_turns_is_followed_scan_by_scan(tmp_path: Path) -> None:
    make = maker_of("bag")
    messages = []
    for k in range(21):
        t = 100.0 + 0.1 * k
        turn = tuple(Rotation.from_euler("z", 0.1 * k).as_quat())
        edge = ("base_link", "laser", (0.0, 0.0, 0.0), turn)
        messages.append(("/tf", t, make.transforms(t, edge)))
        messages.append(("/scan", t, make.laser_scan(t - 0.05, [2.0] * 5)))
    source = open_source(write_recording(tmp_path / "a.bag", messages), SourceConfig())
    headings = [r.scan.robot_from_laser.theta for r in source]
    np.testing.assert_allclose(headings[1:], 0.1 * np.arange(1, 21) - 0.05, atol=1e-6)
    assert math.isclose(headings[0], 0.0, abs_tol=1e-9)
