# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Metrics and report of a finished run, from its parts."""

from __future__ import annotations

from slarm_graph.app.job import Run
from slarm_graph.app.outputs import save_trajectory
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.eval.assessment import ground_truth_in_map
from slarm_graph.eval.metric_parts import References
from slarm_graph.eval.metrics import metrics_csv, metrics_json
from slarm_graph.eval.report import ReportContent, report_html
from slarm_graph.eval.report_figures import GROUND_TRUTH, RAW_ODOMETRY
from slarm_graph.files.config_text import config_yaml
from slarm_graph.geometry import Pose2
from slarm_graph.trajectory import Trajectory

_SLAM_STAGES = ("slam", "optimisation and map", "exploration", "map")


def save_report(folder: RunFolder, run: Run, references: References) -> None:
    """Write `metrics.json`, `metrics.csv`, `ground_truth.tum` and `report.html`."""
    folder.note(scans_per_s=_scans_per_s(folder, run))
    folder.write_text("metrics.json", metrics_json(run.metrics))
    folder.write_text("metrics.csv", metrics_csv(run.metrics))
    save_trajectory(folder, "ground_truth", _at_scans(references.ground_truth, run))
    folder.write_text("report.html", report_html(_content(folder, run, references)))


def _content(folder: RunFolder, run: Run, references: References) -> ReportContent:
    return ReportContent(
        title=run.title,
        lead=f"{run.info.description}; seed {run.config.seed}",
        grid=run.grid,
        trajectories=_trajectories(run, references),
        geographic=run.geographic,
        radio=run.radio,
        metrics=run.metrics,
        record=folder.record(),
        scans=run.log.statuses(),
        tables=run.slam.tables,
        notices=run.notices(),
        config_text=config_yaml(run.config),
    )


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
