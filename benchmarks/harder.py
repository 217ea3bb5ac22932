# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording made harder: the same way seen by a worse laser, in a crowd, with worse odometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from buildings import with_people
from numpy.typing import NDArray

from slarm_graph.eval.relations import Relations
from slarm_graph.geometry import Floats, Pose2, between, compose
from slarm_graph.readings import LaserScan, Reading


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording with true relations between its instants."""

    readings: tuple[Reading, ...]
    relations: Relations


Change = Callable[[Recorded, np.random.Generator], Recorded]
Scans = Callable[[LaserScan, np.random.Generator], LaserScan]
Steps = Callable[[Floats, np.random.Generator], Floats]


def _scans(change: Scans, log: Recorded, rng: np.random.Generator) -> Recorded:
    readings = tuple(replace(r, scan=change(r.scan, rng)) for r in log.readings)
    return replace(log, readings=readings)


def _part(begin: float, log: Recorded, _rng: np.random.Generator) -> Recorded:
    return replace(log, readings=log.readings[int(begin * len(log.readings)) :])


def _every(n: int, log: Recorded, _rng: np.random.Generator) -> Recorded:
    return replace(log, readings=log.readings[n // 2 :: n])


def _reversed(log: Recorded, _rng: np.random.Generator) -> Recorded:
    """Backwards in time: relations lead from the same first instant to the same second one."""
    ends_ns = log.readings[0].stamp_ns + log.readings[-1].stamp_ns
    readings = tuple(replace(r, stamp_ns=ends_ns - r.stamp_ns) for r in reversed(log.readings))
    flipped = replace(log.relations, stamps_ns=ends_ns - log.relations.stamps_ns)
    return Recorded(readings, flipped)


def _mirrored(log: Recorded, _rng: np.random.Generator) -> Recorded:
    def flip(pose: Pose2) -> Pose2:
        return Pose2(pose.x, -pose.y, -pose.theta)

    readings = tuple(
        replace(
            r,
            scan=replace(
                r.scan,
                angle_min_rad=-r.scan.angle_min_rad,
                angle_increment_rad=-r.scan.angle_increment_rad,
                robot_from_laser=flip(r.scan.robot_from_laser),
            ),
            odom_from_robot=flip(r.odom_from_robot) if r.odom_from_robot else None,
        )
        for r in log.readings
    )
    true = log.relations.first_from_second * [1.0, -1.0, -1.0]
    return Recorded(readings, replace(log.relations, first_from_second=true))


def _silent(count: int, seconds: float, log: Recorded, rng: np.random.Generator) -> Recorded:
    stamps = np.array([r.stamp_ns for r in log.readings])
    kept = np.ones(len(stamps), dtype=bool)
    for begin in rng.uniform(stamps[0], stamps[-1], count):
        kept &= (stamps < begin) | (stamps > begin + seconds * 1e9)
    return replace(log, readings=tuple(r for r, k in zip(log.readings, kept, strict=True) if k))


def _crowd(count: int, log: Recorded, rng: np.random.Generator) -> Recorded:
    return replace(
        log, readings=tuple(with_people(list(log.readings), odometry_of(log.readings), count, rng))
    )


def _beams(n: int, scan: LaserScan, _rng: np.random.Generator) -> LaserScan:
    return replace(
        scan,
        ranges_m=scan.ranges_m[::n].copy(),
        angle_increment_rad=n * scan.angle_increment_rad,
        time_increment_s=n * scan.time_increment_s,
    )


def _view(width_rad: float, scan: LaserScan, _rng: np.random.Generator) -> LaserScan:
    angles = scan.angles_rad()
    inside = np.flatnonzero(np.abs(angles) <= 0.5 * width_rad)
    return replace(
        scan, ranges_m=scan.ranges_m[inside].copy(), angle_min_rad=float(angles[inside[0]])
    )


def _changed(
    change: Callable[[Floats, np.random.Generator], Floats],
    scan: LaserScan,
    rng: np.random.Generator,
) -> LaserScan:
    ranges, back = scan.ranges_m.astype(np.float64), scan.is_return()
    ranges[back] = change(ranges[back], rng)
    return replace(scan, ranges_m=ranges)


def _short(reach_m: float, ranges: Floats, _rng: np.random.Generator) -> Floats:
    return np.where(ranges > reach_m, np.inf, ranges)


def _noisy(sigma_m: float, ranges: Floats, rng: np.random.Generator) -> Floats:
    return np.maximum(ranges + rng.normal(0.0, sigma_m, len(ranges)), 0.05)


def _stray(share: float, ranges: Floats, rng: np.random.Generator) -> Floats:
    stray = rng.random(len(ranges)) < share
    return np.where(stray, rng.uniform(0.2, 10.0, len(ranges)), ranges)


def _blind(width_rad: float, scan: LaserScan, rng: np.random.Generator) -> LaserScan:
    """A sector without returns that is somewhere else in every scan."""
    middle = rng.choice(scan.angles_rad())
    ranges = scan.ranges_m.copy()
    ranges[np.abs(scan.angles_rad() - middle) < 0.5 * width_rad] = np.inf
    return replace(scan, ranges_m=ranges)


def odometry_of(readings: Sequence[Reading]) -> Floats:
    """Return the odometry of every reading (N, 3) [m, m, rad]; the origin where there is none."""
    return np.array([(r.odom_from_robot or Pose2()).as_array() for r in readings])


def _odometry(change: Steps, log: Recorded, rng: np.random.Generator) -> Recorded:
    """Change the odometry's steps (N - 1, 3), each in the frame of the pose before."""
    poses = odometry_of(log.readings)
    steps = change(between(poses[:-1], poses[1:]), rng)
    for k, step in enumerate(steps):
        poses[k + 1] = compose(poses[k], step)
    return _with_odometry(log, poses)


def _with_odometry(log: Recorded, poses: Floats) -> Recorded:
    readings = tuple(
        replace(r, odom_from_robot=Pose2.from_array(p))
        for r, p in zip(log.readings, poses, strict=True)
    )
    return replace(log, readings=readings)


def _no_odometry(log: Recorded, _rng: np.random.Generator) -> Recorded:
    return replace(log, readings=tuple(replace(r, odom_from_robot=None) for r in log.readings))


def _restarted(log: Recorded, _rng: np.random.Generator) -> Recorded:
    poses = odometry_of(log.readings)
    half = len(poses) // 2
    poses[half:] = between(poses[half], poses[half:])
    return _with_odometry(log, poses)


def _blinded(
    begin: float, wrong: tuple[float, float, float], log: Recorded, _rng: np.random.Generator
) -> Recorded:
    """Nothing is seen for 40 s, and odometry goes wrong in the middle: carried, or slipped.

    Relations that begin or end meanwhile are left out.
    """
    stamps_ns = np.array([r.stamp_ns for r in log.readings])
    first_ns = stamps_ns[0] + begin * (stamps_ns[-1] - stamps_ns[0])
    last_ns = first_ns + 40e9
    readings = tuple(
        replace(r, scan=replace(r.scan, ranges_m=np.full_like(r.scan.ranges_m, np.inf)))
        if first_ns < r.stamp_ns < last_ns
        else r
        for r in log.readings
    )
    poses = odometry_of(log.readings)
    k = int(np.searchsorted(stamps_ns, 0.5 * (first_ns + last_ns)))
    poses[k:] = compose(compose(poses[k], np.array(wrong)), between(poses[k], poses[k:]))
    ends_ns = log.relations.stamps_ns
    kept = ~((ends_ns > first_ns) & (ends_ns < last_ns)).any(axis=1)
    true = log.relations.first_from_second[kept]
    relations = replace(log.relations, stamps_ns=ends_ns[kept], first_from_second=true)
    return _with_odometry(Recorded(readings, relations), poses)


def _scaled(way: float, turn: float, steps: Floats, _rng: np.random.Generator) -> Floats:
    return steps * [way, way, turn]


def _shaken(share: float, steps: Floats, rng: np.random.Generator) -> Floats:
    return steps * (1.0 + rng.normal(0.0, share, steps.shape))


def _drifting(rad_per_m: float, steps: Floats, _rng: np.random.Generator) -> Floats:
    way = np.hypot(steps[:, 0], steps[:, 1])
    return steps + rad_per_m * way[:, None] * np.array([0.0, 0.0, 1.0])


def _slipping(share: float, steps: Floats, rng: np.random.Generator) -> Floats:
    slips: NDArray[np.bool_] = rng.random(len(steps)) < share
    return np.where(slips[:, None], rng.normal(0.0, [0.3, 0.1, 0.3], steps.shape), steps)


def _stuck(times: int, share: float, steps: Floats, rng: np.random.Generator) -> Floats:
    kept = steps.copy()
    for begin in rng.integers(0, len(steps), times):
        kept[begin : begin + int(share * len(steps))] = 0.0
    return kept


def _both(one: Change, other: Change, log: Recorded, rng: np.random.Generator) -> Recorded:
    return other(one(log, rng), rng)


def _ranges(change: Callable[[Floats, np.random.Generator], Floats]) -> Change:
    return partial(_scans, partial(_changed, change))


VARIANTS: dict[str, Change] = {
    "plain": lambda log, _rng: log,
    "reversed": _reversed,
    "mirrored": _mirrored,
    "from 30 %": partial(_part, 0.3),
    "from 60 %": partial(_part, 0.6),
    "1 scan of 2": partial(_every, 2),
    "1 scan of 4": partial(_every, 4),
    "1 beam of 2": partial(_scans, partial(_beams, 2)),
    "1 beam of 4": partial(_scans, partial(_beams, 4)),
    "120 deg": partial(_scans, partial(_view, math.radians(120))),
    "90 deg": partial(_scans, partial(_view, math.radians(90))),
    "8 m": _ranges(partial(_short, 8.0)),
    "5.6 m": _ranges(partial(_short, 5.6)),
    "noise 3 cm": _ranges(partial(_noisy, 0.03)),
    "noise 6 cm": _ranges(partial(_noisy, 0.06)),
    "10 % stray": _ranges(partial(_stray, 0.1)),
    "60 deg blind": partial(_scans, partial(_blind, math.radians(60))),
    "4 people": partial(_crowd, 4),
    "10 people": partial(_crowd, 10),
    "6 x 4 s silent": partial(_silent, 6, 4.0),
    "no odometry": _no_odometry,
    "odometry way x 1.2": partial(_odometry, partial(_scaled, 1.2, 1.0)),
    "odometry turn x 0.85": partial(_odometry, partial(_scaled, 1.0, 0.85)),
    "odometry noise 30 %": partial(_odometry, partial(_shaken, 0.3)),
    "odometry drift 2 deg/m": partial(_odometry, partial(_drifting, math.radians(2))),
    "odometry slips 1 %": partial(_odometry, partial(_slipping, 0.01)),
    "odometry stuck 6 x 1 %": partial(_odometry, partial(_stuck, 6, 0.01)),
    "odometry restarts": _restarted,
    "1 of 2, 120 deg, 4 people": partial(
        _both,
        partial(_every, 2),
        partial(_both, partial(_scans, partial(_view, math.radians(120))), partial(_crowd, 4)),
    ),
    "blind for 40 s": partial(_blinded, 0.5, (0.0, 0.0, 0.0)),
    "blind for 40 s, carried 1.1 m": partial(_blinded, 0.5, (1.0, 0.5, 0.2)),
    "blind for 40 s, carried 3.2 m": partial(_blinded, 0.5, (3.0, 1.0, 0.7)),
    "8 m, 3 cm, odometry 30 %": partial(
        _both,
        partial(_both, _ranges(partial(_short, 8.0)), _ranges(partial(_noisy, 0.03))),
        partial(_odometry, partial(_shaken, 0.3)),
    ),
}
"""What is made of a recording, by name; each draws from a generator of its own."""
