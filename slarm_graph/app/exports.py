# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A run's results in the formats of other tools: evo, rpg_trajectory_evaluation, GIS."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import AlignmentMethod
from slarm_graph.eval.evaluation import EvaluationOptions, evaluate
from slarm_graph.eval.trajectory_accuracy import absolute_errors, statistics
from slarm_graph.files.coverage import read_coverage
from slarm_graph.files.trajectories import read_spatial, read_trajectory, trajectory_file, tum_text
from slarm_graph.geographic import GeographicMap
from slarm_graph.spatial import SpatialTrajectory
from slarm_graph.trajectory import Trajectory

_RPG_CONFIG = "align_type: se3\nalign_num_frames: -1\n"


def truth_and_estimate(run: Path) -> tuple[SpatialTrajectory, SpatialTrajectory]:
    """Read a run's true and estimated trajectory.

    Raises
    ------
    BadInput
        When the run knows no truth.
    """
    truth = run / "ground_truth.tum"
    if not truth.is_file():
        raise BadInput(f"{run}: no ground_truth.tum in it; this format is about errors")
    return read_spatial(truth), read_spatial(trajectory_file(run))


def write_evo(run: Path, target: Path) -> None:
    """Write the ATE as a result that `evo_res` opens, as `evo_ape tum -a --save_results` does."""
    reference, estimate = truth_and_estimate(run)
    found = evaluate(reference, estimate, EvaluationOptions(AlignmentMethod.SE2))
    errors, pairs = absolute_errors(found.pairs, found.alignment), found.pairs
    values = statistics(errors)
    moved = Trajectory(pairs.stamps_ns, found.alignment.moved(pairs.estimate))
    stats = asdict(values)
    info = {
        "label": "APE (m)",
        "title": f"APE w.r.t. translation part (m)\n(with SE(2) alignment)\n{found.alignment.note}",
        "ref_name": str(run / "ground_truth.tum"),
        "est_name": f"{run.name}",
    }
    arrays = {
        "error_array": errors,
        "timestamps": pairs.stamps_ns * 1e-9,
        "seconds_from_start": pairs.seconds,
    }
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("info.json", json.dumps(info))
        archive.writestr("stats.json", json.dumps(stats))
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.save(buffer, array, allow_pickle=False)
            archive.writestr(f"{name}.npy", buffer.getvalue())
        archive.writestr("ground_truth.tum", tum_text(Trajectory(pairs.stamps_ns, pairs.reference)))
        archive.writestr(f"{run.name}.tum", tum_text(moved))


def write_rpg(run: Path, target: Path) -> None:
    """Write the input folder of rpg_trajectory_evaluation's `analyze_trajectory_single.py`."""
    truth_and_estimate(run)
    target.mkdir(parents=True, exist_ok=True)
    for name, source in (
        ("stamped_groundtruth.txt", run / "ground_truth.tum"),
        ("stamped_traj_estimate.txt", trajectory_file(run)),
    ):
        (target / name).write_text(tum_text(read_trajectory(source)), encoding="utf-8")
    (target / "eval_cfg.yaml").write_text(_RPG_CONFIG, encoding="utf-8")


def write_geojson(run: Path, target: Path) -> None:
    """Write walls and path as GeoJSON, in metres of the map frame, not georeferenced."""
    path = read_trajectory(trajectory_file(run))
    features = [_line("path", path.poses[:, :2].round(4).tolist())]
    if (run / "coverage.npz").is_file():
        features += _obstacles(read_coverage(run / "coverage.npz"))
    content = {"type": "FeatureCollection", "features": features}
    target.write_text(json.dumps(content), encoding="utf-8")


def _line(name: str, points: list[list[float]]) -> dict[str, object]:
    geometry = {"type": "LineString", "coordinates": points}
    return {"type": "Feature", "properties": {"kind": name}, "geometry": geometry}


def _obstacles(geographic: GeographicMap) -> list[dict[str, object]]:
    """Return the outlines of obstacles as polygons with holes."""
    import shapely

    g, occupied = geographic.geometry, geographic.obstacle
    found = []
    for row in np.flatnonzero(occupied.any(axis=1)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], occupied[row].astype(np.int8), [0]])))
        for start, end in edges.reshape(-1, 2):
            x, y = (
                g.origin_x_m + np.array([start, end]) * g.resolution_m,
                g.origin_y_m + row * g.resolution_m,
            )
            found.append(shapely.box(x[0], y, x[1], y + g.resolution_m))
    merged = shapely.union_all(shapely.set_precision(found, 1e-4)) if found else shapely.Polygon()
    parts = [p for p in getattr(merged, "geoms", [merged]) if not p.is_empty]
    return [
        {
            "type": "Feature",
            "properties": {"kind": "obstacle"},
            "geometry": json.loads(shapely.to_geojson(part)),
        }
        for part in parts
    ]
