# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing of the metrics and the report of a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slarm_graph.app.job import Run
from slarm_graph.app.outputs import save_metrics, save_trajectory
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.backend import Table
from slarm_graph.config import RunConfig
from slarm_graph.consistency import Contradictions
from slarm_graph.constraint import ConstraintKind
from slarm_graph.eval.assessment import ground_truth_in_map
from slarm_graph.eval.metric_parts import References
from slarm_graph.eval.position_uncertainty import uncertainty_metrics
from slarm_graph.eval.report import ReportContent, report_html
from slarm_graph.eval.trajectory_figures import GROUND_TRUTH, RAW_ODOMETRY, Marks
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.configs import config_differences
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.trajectory import Trajectory

_SLAM_STAGES = ("slam", "optimisation and map", "exploration", "map")


def save_report(folder: RunFolder, run: Run, references: References) -> None:
    """Write `metrics.json`, `metrics.csv`, `ground_truth.tum` and `report.html`."""
    folder.note(scans_per_s=_scans_per_s(folder, run))
    save_metrics(folder, run.metrics)
    save_trajectory(folder, "ground_truth", _at_scans(references.ground_truth, run))
    folder.write_text("report.html", report_html(_content(folder, run, references)))


def _content(folder: RunFolder, run: Run, references: References) -> ReportContent:
    return ReportContent(
        title=run.title,
        lead=f"{run.info.description}; seed {run.config.seed}{uncertainty(run.slam.covariances)}",
        grid=run.grid,
        trajectories=_trajectories(run, references),
        geographic=run.geographic,
        radio=run.radio,
        measured=run.measured,
        heights=run.heights,
        metrics=run.metrics,
        record=folder.record(),
        scans=run.log.statuses(),
        tables=run.slam.tables,
        notices=run.notices(),
        config_text=config_yaml(run.config),
        config_changes=config_differences(RunConfig(), run.config),
        marks=_marks(run),
        verdict=run.consistency.verdict,
    )


def uncertainty(covariances: Floats | None) -> str:
    """Return a text with the largest 95 % position uncertainty (of N, 3, 3); empty if unknown."""
    found = uncertainty_metrics(covariances)
    return f"; position uncertain by up to {found[0].value:.2g} m (95 %)" if found else ""


def _marks(run: Run) -> Marks:
    """Return loop closures, contradictions and covariances, to be drawn in the map."""
    path, graph = run.slam.trajectory, run.slam.pose_graph
    closures = np.zeros((0, 2, 2))
    if graph is not None:
        kind = ConstraintKind.LOOP_CLOSURE
        pairs = [(c.i, c.j) for c in graph.constraints if c.kind is kind]
        closures = graph.poses[np.array(pairs, dtype=np.int64).reshape(-1, 2), :2]
    rejected = [
        (float(x), float(y), reason)
        for table in run.slam.tables
        if {"stamp_s", "verdict"} <= set(table.columns)
        for stamp_s, reason in _not_accepted(table)
        for x, y, _ in path.at([round(stamp_s * 1e9)])
    ]
    return Marks(closures, rejected, conflict_marks(run.consistency), run.slam.covariances)


def _not_accepted(table: Table) -> Iterator[tuple[float, str]]:
    stamp, verdict = table.columns.index("stamp_s"), table.columns.index("verdict")
    for row in table.rows:
        if row[verdict] != "accepted":
            yield float(row[stamp]), str(row[verdict])


def conflict_marks(result: Contradictions) -> list[tuple[float, float, str]]:
    """Return where the map contradicts itself: x, y [m] and a text."""
    places = [(*p.position_m, f"{p.contradicted} wall cells looked through") for p in result.places]
    steps = [(*t.position_m, "scans and odometry contradict this step") for t in result.tears]
    walls = [
        (float(x), float(y), "wall that another visit looks through") for x, y in result.points_m
    ]
    return [*places, *steps, *walls]


def _scans_per_s(folder: RunFolder, run: Run) -> float:
    """Scans over the time from the first reading to the final map."""
    stages = folder.record()["stages"]
    assert isinstance(stages, dict)
    spent_s = sum(float(stages.get(name, 0.0)) for name in _SLAM_STAGES)
    return round(len(run.log) / max(spent_s, 1e-3), 1)


def _trajectories(run: Run, references: References) -> dict[str, Trajectory]:
    """Return all known paths in the frame of the map, the estimate first."""
    estimate, backend = run.slam.trajectory, run.config.backend
    paths = {backend: estimate}
    odometry = run.log.odometry()
    if odometry is not None and backend != "odometry":
        map_from_odom = Pose2.from_array(estimate.at(odometry.stamps_ns[:1])[0]) @ (
            Pose2.from_array(odometry.poses[0]).inverse()
        )
        paths[RAW_ODOMETRY] = odometry.transformed(map_from_odom)
    if references.ground_truth is not None:
        paths[GROUND_TRUTH] = ground_truth_in_map(references.ground_truth, estimate)
    return paths


def _at_scans(ground_truth: Trajectory | None, run: Run) -> Trajectory | None:
    """Interpolate the true path at the scans that lie within its time."""
    if ground_truth is None:
        return None
    stamps = run.slam.trajectory.stamps_ns
    within = stamps[(stamps >= ground_truth.stamps_ns[0]) & (stamps <= ground_truth.stamps_ns[-1])]
    return Trajectory(within, ground_truth.at(within)) if len(within) else None
