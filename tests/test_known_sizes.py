# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Things of known sizes get their heights: round ones, at walls, on and beside each other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from scanned_rooms import WORLD, scanned_room, toured

from slarm_graph.app.world_accuracy import accuracy_on
from slarm_graph.config import MappingConfig, RadioConfig, RecoveryConfig
from slarm_graph.files.world_shapes import rectangle_m
from slarm_graph.files.worlds import load_world
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.polygons import contains
from slarm_graph.radio.radio_map import radio_map
from slarm_graph.recovery.known_sizes import MeasuredPlan, known_sizes_of, match_size
from slarm_graph.recovery.recover import recover_scans, with_sizes_of
from slarm_graph.world import Solid, WorldMap


def test_known_sizes_are_those_of_the_paper():
    assert known_sizes_of(WORLD) == ((1.3, 1.0, 1.5, 1.0), (7.0, 3.5, 1.8, 1.0))
    assert with_sizes_of(WORLD, RecoveryConfig()).known_sizes == known_sizes_of(WORLD)
    given_sizes = RecoveryConfig(known_sizes=((1.0, 1.0, 1.0),))
    assert with_sizes_of(WORLD, given_sizes) is given_sizes


def drum(name, x_m, y_m, radius_m, height_m):
    angle = np.arange(12) * math.tau / 12
    return Solid(
        name, [x_m, y_m] + radius_m * np.column_stack([np.cos(angle), np.sin(angle)]), height_m
    )


def box(name, center_m, size_m, height_m, heading_deg=0.0):
    return Solid(name, rectangle_m(center_m, size_m, heading_deg), height_m)


WORKSHOP = WorldMap(
    "workshop",
    (
        drum("drum", -1.3, -0.6, 0.3, 0.9),
        box("crate", (1.6, -0.5), (0.6, 0.6), 0.6, 20.0),
        drum("drum at a wall", 0.6, -1.7, 0.3, 0.9),
        drum("drum in a corner", 2.65, 1.65, 0.35, 1.2),
        box("bench", (-0.5, 1.6), (2.4, 0.8), 0.8),
        box("locker", (-2.1, 1.75), (1.2, 0.5), 2.4),
        box("pallet", (0.0, 0.0), (1.0, 0.7), 0.5),
        box("crates on a pallet", (0.5, 0.0), (0.3, 0.7), 1.4),
        box("cabinet", (-2.75, -1.0), (0.5, 1.0), 1.9),
    ),
    np.array([[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0]]),
    3.0,
    (),
    Pose2(-2.0, -1.5, 0.0),
)
WORKSHOP_LOOP = [[-2.0, -1.5], [2.5, -1.3], [2.4, 0.6], [-2.2, 0.7]]
WORKSHOP_ROUND = [[-2.0, -1.5], [2.5, -1.5], [2.4, 1.5], [-2.2, 1.5]]


@pytest.mark.parametrize("sigma_m", [0.0, 0.01])
def test_heights_of_what_is_round_or_stands_at_something(sigma_m):
    scans, trajectory = scanned_room(sigma_m, 0.0, WORKSHOP, WORKSHOP_LOOP)
    geometry = GridGeometry.covering(*WORKSHOP.extent_m(), 0.05)
    config = with_sizes_of(WORKSHOP, RecoveryConfig())
    recovered = recover_scans(scans, trajectory, MappingConfig(), config, geometry=geometry)
    centers = geometry.centers()
    for solid in WORKSHOP.solids:
        inside = contains(solid.corners_m, centers) & recovered.obstacle
        for other in WORKSHOP.solids:
            inside &= (other is solid) | ~contains(other.corners_m, centers)
        # A thing on a thing is seen as one, which is as high as the higher.
        height_m = 1.4 if solid.name == "pallet" else solid.height_m
        right = recovered.heights_m[inside] == np.float32(height_m)
        assert right.mean() > 0.9, solid.name


@pytest.mark.parametrize("heading_deg", [20.0, 35.0, 62.0])
@pytest.mark.parametrize("resolution_m", [0.05, 0.1])
def test_no_cell_at_the_face_of_a_known_thing_is_higher_than_it(heading_deg, resolution_m):
    """Links pass above the crate; one cell of a wall at its slanted face would stop them."""
    crate = box("crate", (0.0, 0.0), (1.2, 0.8), 0.6, heading_deg)
    world = replace(WORKSHOP, solids=(crate,))
    scans, trajectory = scanned_room(0.01, 0.0, world, WORKSHOP_ROUND)
    geometry = GridGeometry.covering(*world.extent_m(), resolution_m)
    config = with_sizes_of(world, RecoveryConfig())
    recovered = recover_scans(scans, trajectory, MappingConfig(), config, geometry=geometry)
    centers = geometry.center_of(np.argwhere(recovered.obstacle))
    here = np.linalg.norm(centers, axis=1) < 1.2
    assert here.sum() > 0.9 * 1.2 * 0.8 / resolution_m**2
    heights_m = recovered.heights_m[recovered.obstacle]
    np.testing.assert_array_equal(heights_m[here], np.float32(0.6))
    assert np.isinf(heights_m[~here]).all()


def test_known_sizes_of_what_touches():
    sizes = known_sizes_of(WORKSHOP)
    # A regular polygon of 12 corners has an area of 3 r^2 in a square of sides 2 r cos(15 deg).
    width_m = 0.6 * math.cos(math.radians(15.0))
    expected = [
        (width_m, width_m, 0.9, 0.27 / width_m**2),
        (1.15, 0.7, 1.4, 1.0),
        (3.4, 0.8, 2.4, (1.92 + 0.6 - 0.1) / (3.4 * 0.8)),
    ]
    for size in expected:
        assert any(np.allclose(size, other, atol=0.005) for other in sizes), size
    # Both drums of one kind are one size; what touches is known in its parts and as a whole.
    assert len(sizes) == len(WORKSHOP.solids) - 1 + 2


def test_no_height_is_promised_that_another_size_of_the_plan_exceeds():
    plan = MeasuredPlan(np.array([1.1, 1.3]), 1.43, 4, np.zeros(2))
    sizes = ((1.3, 1.1, 2.0, 1.0), (1.3, 1.1, 2.3, 1.0), (1.2, 1.1, 2.9, 1.0))
    assert match_size(plan, sizes, 0.15).height_m == 2.3
    assert match_size(plan, sizes[::-1], 0.15).height_m == 2.3


def test_the_share_tells_round_from_square():
    sizes = ((0.6, 0.6, 0.6, 1.0), (0.6, 0.6, 0.9, math.pi / 4))
    for seen in (1, 2, 4):
        round_m2 = 0.36 * (1.0 - (1.0 - math.pi / 4) * seen / 4)
        sides = np.array([0.6, 0.6])
        assert (
            match_size(MeasuredPlan(sides, round_m2, seen, np.zeros(2)), sizes, 0.15).height_m
            == 0.9
        )
        assert match_size(MeasuredPlan(sides, 0.36, seen, np.zeros(2)), sizes, 0.15).misfit_m < 1e-9
    assert match_size(MeasuredPlan(sides, 0.36, 4, np.zeros(2)), sizes, 0.15).height_m == 0.6


def test_a_thing_goes_on_only_as_far_as_the_other_hides():
    size = ((1.1, 0.3, 2.4, 1.0),)
    for unseen_m, found in ((0.0, False), (0.04, False), (0.06, True), (3.2, True)):
        plan = MeasuredPlan(np.array([0.9, 0.3]), 0.27, 1, np.array([unseen_m, 0.0]))
        assert (match_size(plan, size, 0.15) is not None) == found
    longer = MeasuredPlan(np.array([1.4, 0.3]), 0.42, 1, np.array([3.2, 0.0]))
    assert match_size(longer, size, 0.15) is None
    assert match_size(longer, (), 0.15) is None


@pytest.mark.parametrize("seed", range(8))
def test_a_match_is_the_highest_of_the_sizes_that_agree_best(seed: int) -> None:
    """One size at a time, by the words of the docstring."""
    rng = np.random.default_rng(seed)
    sizes = [
        tuple(size) for size in rng.uniform([0.3, 0.2, 0.5, 0.7], [1.0, 0.6, 2.5, 1.0], (9, 4))
    ]
    sizes += [(size[0] + 0.004, *size[1:]) for size in sizes]
    found = 0
    for _ in range(40):
        plan = MeasuredPlan(rng.uniform(0.2, 1.0, 2), rng.uniform(0.1, 0.5), int(rng.integers(5)),
                            rng.choice([0.0, 0.0, 0.2], 2))  # fmt: skip
        misfits = []
        for length, width, _, share in sizes:
            worst = []
            for known in ((length, width), (width, length)):
                off = [
                    min(max(k - s - unseen, 0.0), k - s) if k > s else s - k
                    for k, s, unseen in zip(known, plan.sides_m, plan.unseen_m, strict=True)
                ]
                fits = all(o <= 0.5 * k for o, k in zip(off, known, strict=True))
                worst.append(max(off) if fits else math.inf)
            filled = 1.0 - (1.0 - share) * plan.corners_seen / 4
            by_area = abs(math.sqrt(length * width * filled) - math.sqrt(plan.area_m2))
            misfits.append(max(min(worst), 0.0 if plan.unseen_m.any() else by_area))
        match, best = match_size(plan, sizes, 0.1), min(misfits)
        assert (match is not None) == (best <= 0.1)
        if match is not None:
            found += 1
            alike = [
                s for s, off in zip(sizes, misfits, strict=True) if off <= min(best + 0.01, 0.1)
            ]
            assert match.misfit_m == pytest.approx(best)
            assert match.height_m == max(size[2] for size in alike)
    assert found > 5


def test_sizes_that_cannot_be_are_refused():
    assert RecoveryConfig(known_sizes=((1.0, 2.0, 3.0),)).known_sizes == ((1.0, 2.0, 3.0, 1.0),)
    for size in ((1.0, 2.0), (1.0, 2.0, 0.0), (1.0, 2.0, 3.0, 0.5, 1.0), (1.0, math.inf, 1.0)):
        with pytest.raises(ValidationError, match=r"is not a size|finite number"):
            RecoveryConfig(known_sizes=(size,))
    with pytest.raises(ValidationError, match="at most 1"):
        RecoveryConfig(known_sizes=((1.0, 2.0, 3.0, 1.5),))


def least_accuracy(name: str, resolution_m: float) -> float:
    """Accuracy of the worst access point of a world scanned all over from true poses."""
    world = load_world(name)
    scans, trajectory = toured(world, 0.5, 0.01)
    geometry = GridGeometry.covering(*world.extent_m(), resolution_m)
    recovery = with_sizes_of(world, RecoveryConfig())
    geographic = recover_scans(scans, trajectory, MappingConfig(), recovery, geometry=geometry)
    radio = radio_map(geographic, world.access_points, RadioConfig())
    judged = accuracy_on(world, geographic, radio, RadioConfig(), resolution_m)
    return min(link.accuracy for link in judged.links)


@pytest.mark.parametrize("name", ["paper_room", "cluttered", "office"])
def test_with_sizes_every_access_point_of_a_world_is_right(name: str) -> None:
    assert least_accuracy(name, 0.1) >= 0.98


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["paper_room", "cluttered", "dead_ends", "office", "corridors", "warehouse", "large"],
)
def test_with_sizes_every_access_point_of_all_worlds_is_right_at_fine_cells(name: str) -> None:
    assert least_accuracy(name, 0.05) >= 0.98
