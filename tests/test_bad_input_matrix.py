# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What users give that is bad, row by row: where the right line or value is tested."""

from __future__ import annotations

import ast
import errno
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from driven_bags import drive
from ros_bags import write_recording

from slarm_graph.app.cli import main
from slarm_graph.trajectory import Trajectory

ROWS = {
    "missing path": "test_sources::test_missing_path",
    "empty .bag, text named .bag": "test_sources::test_empty_file_and_text_named_bag",
    "truncated .bag": "test_sources::test_truncated_bag_is_used_as_far_as_it_goes",
    "truncated .mcap": "test_sources::test_truncated_mcap_is_used_as_far_as_it_goes",
    "truncated .db3": "test_sources::test_truncated_db3_is_used_as_far_as_it_goes",
    "ROS 2 folder without metadata.yaml, or metadata.yaml given": (
        "test_sources::test_ros2_storage_is_found_however_it_is_named"
    ),
    "no LaserScan": "test_sources::test_no_laser_scan_lists_what_there_is",
    "two LaserScan topics": "test_sources::test_two_laser_scans_list_frames_rates_and_the_flag",
    "laser frame not in tf": (
        "test_source_faults::test_laser_frame_not_in_tf_tells_both_trees_and_the_option"
    ),
    "no odometry": "test_source_faults::test_no_odometry_goes_on",
    "odometry stops half way": "test_source_faults::test_odometry_stops_half_way",
    "all stamps 0": "test_source_faults::test_all_stamps_zero_uses_record_time",
    "duplicate or reversed stamps": (
        "test_source_faults::test_reversed_and_repeated_stamps_are_sorted_and_told_apart"
    ),
    "clock jumps back 60 s": "test_source_faults::test_clock_jumps_back_lists_segments",
    "number of beams changes": "test_source_faults::test_beam_count_may_change",
    "span of 0 to 361 degrees": "test_source_faults::test_more_than_a_turn_is_kept",
    "range_max 0, range_min above range_max": "test_source_faults::test_impossible_range_limits",
    "all ranges inf or nan": "test_source_faults::test_no_scan_has_a_return",
    "most scans unusable": "test_source_faults::test_most_scans_unusable_is_refused",
    "same scan repeated": "test_source_faults::test_the_same_scan_again_and_again",
    "quaternion 0 0 0 0": "test_source_faults::test_odometry_with_zero_quaternions",
    "tf map -> odom recorded": "test_source_faults::test_map_to_odom_in_tf_is_ignored",
    "truth offset by 100 s": "test_bad_input_matrix::test_an_offset_of_the_clock_is_suggested",
    "truth is a straight line": "test_trajectory_accuracy::test_a_straight_path_can_be_aligned",
    "truth stands still": (
        "test_trajectory_accuracy::test_a_robot_that_stood_still_is_aligned_by_its_origin"
    ),
    "truth with nan, 7 columns or csv": "test_trajectory_files::test_names_file_and_line",
    "estimate and reference swapped": "test_bad_input_matrix::test_every_table_says_what_is_true",
    "typo in the configuration": "test_cli::test_a_typo_in_the_configuration",
    "folder that cannot be written": "test_cli::test_a_folder_that_cannot_be_written",
    "no symbolic links": "test_run_folder::test_without_links_latest_is_a_text_file",
    "full disk": "test_bad_input_matrix::test_a_disk_that_fills_up",
    "full disk, checkpoint": (
        "test_feeding::test_a_checkpoint_that_cannot_be_written_is_told_and_the_run_goes_on"
    ),
    "g2o with early FIX or comment": (
        "test_g2o::test_tolerates_comments_early_fix_gaps_and_unknown_tags"
    ),
    "GTSAM absent": "test_bad_input_matrix::test_other_backends_run_without_gtsam",
    "Ctrl-C": "test_cli::test_interrupt_keeps_partial_results_and_resume_ends_the_same",
    "corridor of 9000 poses": "test_pose_graph_optimizer::test_straight_corridor",
}


@pytest.mark.parametrize("row", ROWS)
def test_every_row_has_its_test(row: str) -> None:
    module, _, name = ROWS[row].partition("::")
    source = (Path(__file__).parent / f"{module}.py").read_text(encoding="utf-8")
    functions = {node.name for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}
    assert name in functions


def _written(path: Path, offset_s: float = 0.0, every: int = 1) -> Path:
    stamps = 1e9 * (1_700_000_000.0 + offset_s + 0.1 * np.arange(0, 200, every))
    along = 0.1 * np.arange(0, 200, every)
    poses = np.stack([along, np.sin(along), np.cos(along)], axis=1)
    path.write_text(_tum(Trajectory(stamps.astype(np.int64), poses)))
    return path


def _tum(trajectory: Trajectory) -> str:
    from slarm_graph.files.trajectories import tum_text

    return tum_text(trajectory)


def test_an_offset_of_the_clock_is_suggested(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, late = _written(tmp_path / "truth.tum"), _written(tmp_path / "late.tum", 100.0)
    assert main(["eval", "trajectory", str(truth), str(late)]) == 2
    assert "--t-offset -100.000" in capsys.readouterr().err


def test_every_table_says_what_is_true(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dense, sparse = _written(tmp_path / "dense.tum"), _written(tmp_path / "sparse.tum", every=20)
    for truth, estimate in ((sparse, dense), (dense, sparse)):
        assert main(["eval", "trajectory", str(truth), str(estimate)]) == 0
        head = capsys.readouterr().out.splitlines()[0]
        assert head.startswith(f"{estimate.name} against {truth.name}, ")
        assert main(["eval", "trajectory", *map(str, (truth, estimate, truth))]) == 0
        assert capsys.readouterr().out.splitlines()[0].strip() == f"against {truth.name}"


def test_a_disk_that_fills_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_recording(tmp_path / "a.bag", drive())
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if "map" in path.name:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    out = tmp_path / "runs"
    code = main(["run", str(bag), "-b", "odometry", "--out", str(out), "--name", "one"])
    assert code == 1
    (line,) = [x for x in capsys.readouterr().err.splitlines() if x.startswith("slarm: ")]
    assert "No space left on device" in line
    assert (out / "one" / "trajectory.tum").is_file()
    assert '"partial"' in (out / "one" / "run.json").read_text()


def test_other_backends_run_without_gtsam(tmp_path: Path) -> None:
    bag = write_recording(tmp_path / "a.bag", drive())
    without = "import sys; sys.modules['gtsam'] = None; from slarm_graph.app.cli import main; "

    def said(*words: object) -> tuple[int, str]:
        command = [sys.executable, "-c", f"{without}sys.exit(main(sys.argv[1:]))", *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        return done.returncode, done.stdout + done.stderr

    out = ("--out", tmp_path / "runs")
    assert said("run", bag, "-b", "odometry", *out)[0] == 0
    code, text = said("run", bag, "-b", "pose_graph", *out)
    assert code == 2 and "gtsam" in text and "Traceback" not in text
    assert any("pose_graph" in x and "gtsam" in x for x in said("backends")[1].splitlines())
