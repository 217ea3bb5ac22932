# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The particle filter backend from readings to result, in the paper's room."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from slarm_graph import backends
from slarm_graph.backend import SlamResult
from slarm_graph.backends import rbpf
from slarm_graph.backends.gmapping import GmappingBackend
from slarm_graph.backends.particle_filter import normalised
from slarm_graph.config import (
    FrontendConfig,
    GmappingConfig,
    LidarConfig,
    ParticleMapsConfig,
    ProposalConfig,
    ResamplingConfig,
    RunConfig,
    SimulationConfig,
    WheelConfig,
)
from slarm_graph.errors import RunFailed
from slarm_graph.eval.alignment import fit
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, tour
from slarm_graph.geometry import Floats, Pose2, wrap_angles
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.trajectory import Trajectory

NOISELESS = SimulationConfig(
    lidar=LidarConfig(sigma_m=0.0),
    wheels=WheelConfig(
        wheel_base_error=0.0, left_slip=0.0, right_slip=0.0, random_slip_m_per_sqrt_m=0.0
    ),
)


@cache
def recorded(
    seed: int = 0, speed_m_s: float = 0.6, noiseless: bool = False
) -> tuple[tuple[Reading, ...], Trajectory]:
    """A tour of the paper's room: readings and where the robot truly was."""
    world, config = load_world("paper_room"), NOISELESS if noiseless else SimulationConfig()
    source = SourceFromWorld(
        world, config, seed=seed, script=tour(world, config, speed_m_s=speed_m_s)
    )
    readings = tuple(source)
    return readings, source.truth()


def made(particles: int = 10, **changes: object) -> GmappingBackend:
    settings = GmappingConfig(particles=particles).model_copy(update=changes)
    return GmappingBackend(settings, FrontendConfig(), np.random.default_rng(0))


def run(backend: GmappingBackend, readings: tuple[Reading, ...]) -> SlamResult:
    for reading in readings:
        backend.update(reading)
    return backend.result()


def ate_m(trajectory: Trajectory, truth: Trajectory) -> float:
    """RMSE of the positions after SE(2) alignment [m]."""
    estimated, true = trajectory.poses[:, :2], truth.poses[:, :2]
    errors = fit(estimated, true).reference_from_estimate.transform(estimated) - true
    return float(np.sqrt(np.square(errors).sum(axis=1).mean()))


def test_it_is_registered() -> None:
    backend = backends.make("gmapping", RunConfig(), np.random.default_rng(0), print)
    assert isinstance(backend, GmappingBackend)


def test_without_noise_the_path_is_true() -> None:
    readings, truth = recorded(noiseless=True)
    backend = made()
    result = run(backend, readings)
    assert result.trajectory.stamps_ns.tolist() == [r.stamp_ns for r in readings]
    assert ate_m(result.trajectory, truth) < 0.01
    mean = np.array(next(t for t in result.tables if t.name == "weighted_mean").rows)[:, 1:]
    assert ate_m(Trajectory(result.trajectory.stamps_ns, mean), truth) < 0.01
    last = Pose2.from_array(result.trajectory.poses[-1]).between(backend.map_from_robot())
    assert np.allclose(last.as_array(), 0.0, atol=1e-9)


@pytest.mark.parametrize("speed_m_s", [0.6, 1.0])
def test_the_papers_room(speed_m_s: float) -> None:
    readings, truth = recorded(1, speed_m_s)
    assert ate_m(run(made(30), readings).trajectory, truth) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("speed_m_s", [0.6, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_the_papers_room_five_times(speed_m_s: float, seed: int) -> None:
    readings, truth = recorded(seed, speed_m_s)
    assert ate_m(run(made(30), readings).trajectory, truth) <= 0.02


def test_asking_for_the_result_early_and_often_changes_nothing() -> None:
    readings = recorded()[0][:300]
    often, once = made(), made()
    for count, reading in enumerate(readings):
        often.update(reading)
        once.update(reading)
        if count % 40 == 0:
            often.result()
    result, single = often.result(), once.result()
    assert result.trajectory.poses.tobytes() == single.trajectory.poses.tobytes()


@pytest.mark.parametrize("improved", [True, False])
def test_the_number_of_threads_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, improved: bool
) -> None:
    readings = recorded()[0][:250]
    proposal = ProposalConfig(improved=improved)
    paths = []
    for cores in (1, 3, 7):
        monkeypatch.setattr(rbpf, "usable_cores", lambda count=cores: count)
        paths.append(run(made(7, proposal=proposal), readings).trajectory.poses.tobytes())
    assert paths[0] == paths[1] == paths[2]


def test_a_restored_snapshot_goes_on_as_if_nothing_had_happened() -> None:
    readings = recorded()[0][:400]
    straight, stopped = made(), made()
    for reading in readings[:200]:
        straight.update(reading)
        stopped.update(reading)
    resumed = GmappingBackend(
        GmappingConfig(particles=10), FrontendConfig(), np.random.default_rng(99)
    )
    resumed.restore(stopped.snapshot())
    a, b = run(straight, readings[200:]), run(resumed, readings[200:])
    assert a.trajectory.poses.tobytes() == b.trajectory.poses.tobytes()
    assert a.tables == b.tables


def test_covariances_without_a_graph_are_those_of_the_particles_about_the_best() -> None:
    backend = made(places=None)
    result = run(backend, recorded()[0][:100])
    state = backend._state
    known, at, best = result.covariances, state.updates, state.filter.poses[state.filter.best()]
    assert known is not None
    assert known.shape == (len(result.trajectory), 3, 3)
    heading = state.filter.poses[:, 2] - best[2]
    spread = np.square(wrap_angles(heading)) @ normalised(state.filter.log_weights)
    assert known[at[-1], 2, 2] == pytest.approx(spread + 0.002**2)
    # All come from one start, of which the floor is left: a proposal's least and that of a cell.
    np.testing.assert_allclose(known[0, 0, 0], 0.005**2 + 0.05**2 / 12.0)


def test_eq_11_and_the_filters_books_are_shown() -> None:
    readings = recorded()[0][:300]
    backend = made(resampling=ResamplingConfig(resample_threshold=1.0))
    result = run(backend, readings)
    table, mean, _closures = result.tables
    assert (table.name, mean.name) == ("particles", "weighted_mean")
    assert len(mean.rows) == len(readings)
    distance = np.array(mean.rows)[:, 1:3] - result.trajectory.poses[:, :2]
    assert np.linalg.norm(distance, axis=1).max() < 0.1
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    assert [r["stamp_ns"] for r in rows] == sorted(r["stamp_ns"] for r in rows)
    resampled = [r for r in rows if r["resampled"]]
    assert resampled
    for row in rows:
        assert 1.0 - 1e-9 <= float(row["n_eff"]) <= 10.0 + 1e-9
        assert row["resampled"] or row["distinct_ancestors"] == 10
        assert math.isfinite(float(row["mean_x_m"]))
    assert any("10 particles" in notice for notice in result.notices)


def test_much_memory_is_noticed_before_the_run() -> None:
    backend = made(maps=ParticleMapsConfig(delta_m=0.01))
    assert any("may need" in notice for notice in run(backend, recorded()[0][:2]).notices)


def test_scans_without_returns_keep_the_frontends_pose() -> None:
    readings = recorded()[0][:60]
    blind = LaserScan(np.full(360, np.inf), 0.0, 0.017, 0.1, 8.0)
    mixed = tuple(
        Reading(r.stamp_ns, blind if 20 <= i < 25 else r.scan, r.odom_from_robot)
        for i, r in enumerate(readings)
    )
    result = run(made(), mixed)
    assert len(result.trajectory) == 60
    assert np.isfinite(result.trajectory.poses).all()


def test_odometry_alone_after_a_long_silence_is_as_sure_as_odometry() -> None:
    """Nothing seen before and for some scans after: particles were drawn over 13 km, and died."""
    readings, truth = recorded()
    late_ns = 160_000_000_000
    blind = [
        replace(r, scan=replace(r.scan, ranges_m=np.full_like(r.scan.ranges_m, np.inf)))
        for r in readings[:30]
    ]
    moved = [replace(r, stamp_ns=r.stamp_ns + late_ns) for r in (*blind[1:], *readings[30:])]
    backend = made()
    slam = run(backend, (blind[0], *moved))
    np.testing.assert_allclose(ate_m(slam.trajectory, truth), 0.0, atol=0.05)


def test_nothing_but_blind_scans_is_survived() -> None:
    blind = LaserScan(np.full(360, np.inf), 0.0, 0.017, 0.1, 8.0)
    result = run(made(), tuple(Reading(i * 10**8, blind, Pose2(0.1 * i)) for i in range(30)))
    assert len(result.trajectory) == 30


def test_a_turn_on_the_spot_is_a_reason_to_update() -> None:
    """By default each quarter of a radian, and not at every scan."""
    readings = []
    for k in range(21):
        beams = (np.arange(360) + 0.5) * np.pi / 180 + 0.05 * k
        x, y = np.cos(beams), np.sin(beams)
        to_x = np.where(x > 0, 3.0, 2.0) / np.maximum(np.abs(x), 1e-9)
        to_y = np.where(y > 0, 4.0, 1.5) / np.maximum(np.abs(y), 1e-9)
        ranges = np.minimum(to_x, to_y).astype(np.float32)
        scan = LaserScan(ranges, 0.5 * np.pi / 180, np.pi / 180, 0.1, 30.0)
        readings.append(Reading(k * 200_000_000, scan, Pose2(0.0, 0.0, 0.05 * k)))
    result = run(made(), tuple(readings))
    updates = next(t for t in result.tables if t.name == "particles")
    assert len(updates.rows) in (3, 4)
    np.testing.assert_allclose(result.trajectory.poses[-1], [0.0, 0.0, 1.0], atol=0.02)


def test_needs_a_scan() -> None:
    with pytest.raises(RunFailed, match="no scan"):
        made().result()


def mean_errors(recording: Path, seed: int) -> Floats:
    """Mean translation [m] and rotation [deg] errors over all relations, at the laser."""
    backend = GmappingBackend(GmappingConfig(), FrontendConfig(), np.random.default_rng(seed))
    scan = None
    for reading in open_source([recording], RunConfig().source):
        backend.update(reading)
        scan = reading.scan
    assert scan is not None
    relations = read_relations(recording.with_name(recording.name.replace(".clf.gz", ".relations")))
    errors = relation_errors(relations, backend.result().trajectory, scan.robot_from_laser)
    return np.array([errors.translation_m.mean(), np.degrees(errors.rotation_rad.mean())])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "median_m", "median_deg", "worst_m"),
    [("intel", 0.0255, 0.6, 0.05), ("fr079", 0.050, 0.6, 0.10), ("mit-csail", 0.040, 1.0, 0.08)],
)
def test_real_recordings(
    shared_data: Path, name: str, median_m: float, median_deg: float, worst_m: float
) -> None:
    recording = shared_data / "benchmark" / f"{name}.clf.gz"
    errors = np.array([mean_errors(recording, seed) for seed in range(5)])
    assert np.median(errors[:, 0]) <= median_m
    assert np.median(errors[:, 1]) <= median_deg
    assert errors[:, 0].max() <= worst_m


def test_parameters_that_mean_the_same_have_gmappings_defaults() -> None:
    config = GmappingConfig()
    assert config.particles == 30
    assert config.maps.delta_m == 0.05
    assert config.proposal.kernel_size == 1
    assert config.likelihood.lskip == 0
    assert config.likelihood.max_range_m is None
    assert config.resampling.resample_threshold == 0.5
