# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is read, and the small whole files that damage begins with."""

from __future__ import annotations

import contextlib
import functools
import gzip
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from driven_bags import drive
from ros_bags import write_recording

from slarm_graph import backends
from slarm_graph.access_points import AccessPoint
from slarm_graph.app.checkpoint import saved_states
from slarm_graph.app.resuming import resumed_job
from slarm_graph.backend import SlamBackend
from slarm_graph.config import RunConfig, SourceConfig
from slarm_graph.eval.relations import read_relations
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.configs import load_config
from slarm_graph.files.coverage import read_coverage, write_coverage
from slarm_graph.files.g2o import read_g2o
from slarm_graph.files.maps import read_map, trinary_image
from slarm_graph.files.states import SavedStates, write_states
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geographic import as_geographic
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.files import read_radio_npz, write_radio_npz
from slarm_graph.radio.radio_map import radio_map

Read = Callable[[Path], object]


@dataclass(frozen=True, slots=True)
class Target:
    """A kind of input.

    Parameters
    ----------
    name : str
    seeds : tuple of bytes
        Whole files.
    file : str
        Path of the damaged file below a folder of its own; what lies beside it is in `others`.
    read : callable
        Reads the folder's file.
    as_text : bool
    others : dict of name to bytes
    """

    name: str
    seeds: tuple[bytes, ...]
    file: str
    read: Read
    as_text: bool = False
    others: tuple[tuple[str, bytes], ...] = ()


def _recording(path: Path) -> None:
    """Open it and read it to the end, and diagnose it, which never fails by itself."""
    found = [f for f in check(path).findings if "not foreseen" in f.advice]
    if found:
        raise AssertionError(found[0].what)
    list(open_source(path, SourceConfig()))


def _whole_recording(kind: str, compression: str = "") -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        made = write_recording(
            Path(folder) / f"r.{kind}", drive(kind, scans=24), kind, compression=compression
        )
        file = made if made.is_file() else next(made.glob(f"*.{kind}"))
        return file.read_bytes()


def _carmen() -> bytes:
    rng = np.random.default_rng(0)
    lines = ["# a log", "PARAM robot_length 1 0 h 0"]
    for k in range(12):
        ranges = " ".join(f"{r:.2f}" for r in 1 + rng.random(20))
        pose = f"{0.1 * k:.3f} 0 0"
        lines.append(f"ODOM {pose} 0.1 0 0 {k}.0 host {k}.0")
        lines.append(f"FLASER 20 {ranges} {pose} {pose} {k}.1 host {k}.1")
        head = f"ROBOTLASER1 0 -1.5 3.1 0.15 30 0.01 0 20 {ranges} 0"
        lines.append(f"{head} {pose} {pose} 0 0 0 0 0 {k}.2 host {k}.2")
    return "\n".join(lines).encode() + b"\n"


def _grid() -> OccupancyGrid:
    cells = np.random.default_rng(0).choice([0.0, 1.0, np.nan], (12, 9)).astype(np.float32)
    return OccupancyGrid(GridGeometry(-1.0, 2.0, 0.1, 12, 9), cells)


WORLD = b"""name: w
ceiling_m: 3.0
boundary_m: [[0, 0], [6, 0], [6, 4], [0, 4]]
start: {x_m: 1.0, y_m: 1.0, heading_deg: 30}
access_points:
  - {name: a, x_m: 3, y_m: 3.9, z_m: 2.5, power_dbm: 20}
walls:
  - {line_m: [[2, 1], [4, 1], [4, 3]], thickness_m: 0.2, height_m: 2}
boxes:
  - {name: b, center_m: [5, 3], size_m: [0.5, 0.7], heading_deg: 10, height_m: 1}
polygons:
  - {name: p, corners_m: [[1, 3], [1.5, 3], [1.2, 3.5]], height_m: 1}
"""
MAP = b"""image: m.pgm
mode: trinary
resolution: 0.1
origin: [-1.0, 2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
TUM = b"# timestamp tx ty tz qx qy qz qw\n" + b"".join(
    b"%d.5 %d 0.5 0 0 0 0 1\n" % (k, k) for k in range(9)
)
KITTI = b"".join(b"1 0 0 %d 0 1 0 0.5 0 0 1 0\n" % k for k in range(9))
EUROC = b"#timestamp, p_x, p_y, p_z, q_w, q_x, q_y, q_z\n" + b"".join(
    b"%d,%d,0.5,0,1,0,0,0\n" % (1403636580838555648 + 10**9 * k, k) for k in range(9)
)
G2O = (
    b"".join(b"VERTEX_SE2 %d %d 0 0\n" % (k, k) for k in range(6))
    + b"".join(b"EDGE_SE2 %d %d 1 0 0 100 0 0 100 0 1000\n" % (k, k + 1) for k in range(5))
    + b"FIX 0\n# end\n"
)
RELATIONS = b"".join(b"%d.0 %d.0 1 0.1 0 0 0 0.01\n" % (k, k + 1) for k in range(9))
RECORD = json.dumps(
    {
        "status": "partial",
        "wall_s": 1.5,
        "cpu_s": 2.0,
        "stages": {"slam": 1.0},
        "input": {"paths": ["/nowhere/a.bag"], "size_bytes": 1, "sha256": "x"},
        "job": {
            "access_points": [{"name": "a", "x_m": 0, "y_m": 0, "z_m": 1}],
            "ground_truth": None,
            "relations": None,
        },
    },
    indent=1,
).encode()


def _written(write: Callable[[Path], object], name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def _images() -> tuple[bytes, ...]:
    image = trinary_image(_grid().occupied, _grid().free)
    encoded = [
        cv2.imencode(ending, image)[1].tobytes() for ending in (".pgm", ".png", ".bmp", ".jpg")
    ]
    text = b"P2\n9 12\n255\n" + b" ".join(b"%d" % v for v in image.ravel().tolist())
    return (*encoded, text)


def _backend() -> SlamBackend:
    """Make the backend with the smallest state."""
    return backends.make("odometry", RunConfig(), np.random.default_rng(0), print)


def _checkpoint() -> bytes:
    saved = SavedStates({"backend": _backend().snapshot()}, {"latest_ns": 3})
    return _written(lambda path: write_states(path, saved), "state.npz")


def _resume(path: Path) -> None:
    with saved_states(path.parent.parent) as saved:
        assert saved is not None
        _backend().restore(saved.states["backend"])


@functools.cache
def targets() -> tuple[Target, ...]:
    """Every kind of input there is, with its seeds."""
    geographic = as_geographic(_grid(), 2.0)
    radio = radio_map(geographic, [AccessPoint("a", -0.5, 2.5, 2.0)], RunConfig().radio)
    pgm = _images()[0]
    config = config_yaml(RunConfig()).encode()
    bags = tuple(_whole_recording("bag", c) for c in ("", "BZ2", "LZ4"))
    return (
        Target("bag", bags, "r.bag", _recording),
        Target(
            "mcap",
            (_whole_recording("mcap"), _whole_recording("mcap", "STORAGE")),
            "r.mcap",
            _recording,
        ),
        Target("db3", (_whole_recording("db3"),), "r.db3", _recording),
        Target("carmen", (_carmen(),), "r.clf", _recording, as_text=True),
        Target("carmen gzip", (gzip.compress(_carmen()),), "r.clf.gz", _recording),
        Target("map yaml", (MAP,), "m.yaml", read_map, as_text=True, others=(("m.pgm", pgm),)),
        Target(
            "map image",
            _images(),
            "m.pgm",
            lambda path: read_map(path.with_name("m.yaml")),
            others=(("m.yaml", MAP),),
        ),
        Target("world", (WORLD,), "w.yaml", load_world, as_text=True),
        Target("config", (config,), "c.yaml", load_config, as_text=True),
        Target("tum", (TUM,), "t.tum", read_trajectory, as_text=True),
        Target("kitti", (KITTI,), "t.txt", read_trajectory, as_text=True),
        Target("euroc", (EUROC,), "t.csv", read_trajectory, as_text=True),
        Target("g2o", (G2O,), "g.g2o", read_g2o, as_text=True),
        Target("relations", (RELATIONS,), "r.relations", read_relations, as_text=True),
        Target("coverage", (_written(lambda p: write_coverage(p, geographic), "c.npz"),), "c.npz",
               read_coverage),
        Target("radio map", (_written(lambda p: write_radio_npz(p, radio), "r.npz"),), "r.npz",
               read_radio_npz),
        Target("checkpoint", (_checkpoint(),), "checkpoint/state.npz", _resume),
        Target(
            "run.json",
            (RECORD,),
            "run.json",
            lambda path: resumed_job(path.parent, None, ()),
            as_text=True,
            others=(("config.yaml", config),),
        ),
    )  # fmt: skip


def lay_out(target: Target, folder: Path, data: bytes) -> Path:
    """Write a damaged file and what belongs beside it."""
    for name, content in target.others:
        (folder / name).write_bytes(content)
    path = folder / target.file
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    path.write_bytes(data)
    return path
