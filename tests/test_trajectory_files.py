# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""TUM as evo reads it, round trips to the nanosecond, and every bad line named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from slarm_graph.errors import BadInput
from slarm_graph.files.trajectories import read_spatial, read_trajectory, trajectory_file, tum_text
from slarm_graph.files.trajectory_columns import columns_by_custom, stamp_ns
from slarm_graph.spatial import SpatialTrajectory
from slarm_graph.stamps import ns_to_seconds, seconds_to_ns
from slarm_graph.trajectory import Trajectory

STAMP_NS = 1_700_000_000_123_456_789


def spiral(count: int = 60) -> Trajectory:
    angle = np.linspace(-3.2, 3.2, count)
    stamps = STAMP_NS + np.arange(count) * 100_000_007
    return Trajectory(stamps, np.column_stack([np.cos(angle), angle, 2 * angle]))


def written(tmp_path: Path, text: str | bytes, name: str = "t.tum") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@given(st.integers(-(2**62), 2**62))
def test_nanoseconds_survive_as_text(stamp_ns: int) -> None:
    assert seconds_to_ns(ns_to_seconds(stamp_ns)) == stamp_ns


def test_round_trip_keeps_stamps_exactly_and_poses_to_a_nanometre(tmp_path: Path) -> None:
    path = spiral()
    back = read_trajectory(written(tmp_path, tum_text(path)))
    assert np.array_equal(back.stamps_ns, path.stamps_ns)
    assert np.allclose(back.poses[:, :2], path.poses[:, :2], atol=1e-9)
    turn = np.angle(np.exp(1j * (back.poses[:, 2] - path.poses[:, 2])))
    assert np.abs(turn).max() < 1e-11


def test_evo_reads_what_is_written(tmp_path: Path) -> None:
    path = spiral()
    theirs = file_interface.read_tum_trajectory_file(written(tmp_path, tum_text(path)))
    assert theirs.check()[0]
    assert np.allclose(theirs.positions_xyz[:, :2], path.poses[:, :2], atol=1e-9)
    headings = [np.arctan2(m[1, 0], m[0, 0]) for m in theirs.poses_se3]
    assert np.allclose(np.exp(1j * np.array(headings)), np.exp(1j * path.poses[:, 2]), atol=1e-9)


def test_lines_are_strict_tum() -> None:
    text = tum_text(Trajectory(np.array([5]), np.array([[-1e-12, 2.0, 0.0]])))
    assert text == (
        "# timestamp tx ty tz qx qy qz qw\n"
        "0.000000005 0.000000000 2.000000000 0.000000000"
        " 0.000000000000 0.000000000000 0.000000000000 1.000000000000\n"
    )


def test_tolerates_what_other_tools_write(tmp_path: Path) -> None:
    text = "\ufeff# comment\r\n\r\n1.5\t1  2 0 0 0 0 1 \r\n2.5 3 4 0 0 0 1 0\t\r\n\r\n"
    path = read_trajectory(written(tmp_path, text))
    assert path.stamps_ns.tolist() == [1_500_000_000, 2_500_000_000]
    assert np.allclose(path.poses, [[1, 2, 0], [3, 4, np.pi]])


def test_reads_euroc_with_w_first(tmp_path: Path) -> None:
    text = "#timestamp [ns],x,y,z,qw,qx,qy,qz\n1403636579763555584,1,2,0,0,0,0,1,9,9\n"
    path = read_trajectory(written(tmp_path, text, "data.csv"))
    assert path.stamps_ns[0] == 1403636579763555584
    assert np.allclose(path.poses, [[1, 2, np.pi]])


@pytest.mark.parametrize(
    ("stamp", "more"), [("1403636579763555584", 0), ("1403636579763555584", 9), ("5000000000", 9)]
)
def test_euroc_without_its_header_is_what_it_is_with_it(
    tmp_path: Path, stamp: str, more: int
) -> None:
    header = "#timestamp [ns],x,y,z,qw,qx,qy,qz" + "".join(f",b{k}" for k in range(more)) + "\n"
    text = f"{stamp},1,2,3,0.5,0.1,-0.7,0.5" + ",9" * more + "\n"
    with_it = read_spatial(written(tmp_path, header + text, "a.csv"))
    without = read_spatial(written(tmp_path, text, "b.csv"))
    assert without.stamps_ns.tolist() == with_it.stamps_ns.tolist() == [int(stamp)]
    assert without.poses.tolist() == with_it.poses.tolist()


@pytest.mark.parametrize("count", [8, 9, 12, 16, 17])
def test_what_the_remedy_names_is_read(tmp_path: Path, count: int) -> None:
    """The header that a message proposes makes every table of at least so many columns read."""
    head = "timestamp,x,y,z,qx,qy,qz,qw" + "".join(f",b{k}" for k in range(count - 8)) + "\n"
    text = f"{head}1.5,1,2,3,0.1,-0.7,0.5,0.5" + ",9" * (count - 8) + "\n"
    assert read_spatial(written(tmp_path, text)).poses[0, :6] == pytest.approx(
        [1.0, 2.0, 3.0, 0.1, -0.7, 0.5]
    )


def test_reads_kitti_with_a_second_between_poses(tmp_path: Path) -> None:
    path = read_trajectory(written(tmp_path, "1 0 0 7 0 1 0 8 0 0 1 0\n0 -1 0 7 1 0 0 9 0 0 1 0\n"))
    assert path.stamps_ns.tolist() == [0, 1_000_000_000]
    assert np.allclose(path.poses, [[7, 8, 0], [7, 9, np.pi / 2]])


def test_sorts_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    line = "{} {} 0 0 0 0 0 1\n"
    text = "".join(line.format(stamp, stamp) for stamp in (3, 1, 2, 2))
    logger = "slarm_graph.files.trajectories"
    with caplog.at_level("WARNING", logger):
        path = read_trajectory(written(tmp_path, text))
    assert path.poses[:, 0].tolist() == [1, 2, 3]
    assert "sorted, and 1 repeated stamp left out" in caplog.text


def test_says_nothing_of_stamps_that_do_not_repeat(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    read_trajectory(written(tmp_path, "".join(f"{t} 1 0 0 0 0 0 1\n" for t in (3, 1, 2))))
    assert caplog.messages[0].endswith("do not increase strictly; sorted")


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("1 2 3 0 0 0 0 1\n2 2 3 0 0 0 1\n", 2, "expected 8 numbers, got 7"),
        ("1 2 3 0 0 0 0\n", 1, "expected 8 numbers (TUM)"),
        ("1 2 3 0 0 0 0 1\n\n# c\nnan 2 3 0 0 0 0 1\n", 4, "not a finite number"),
        ("1 2 3 0 0 0 0 1\n1e30 2 3 0 0 0 0 1\n", 2, "beyond what 64 bits"),
        ("1 x 3 0 0 0 0 1\n", 1, "could not convert"),
        ("1 2 3 0 0 0 0 0\n", 1, "quaternion of length 0"),
        ("5000000000,1,2,0,0.8,0,0,0.6\n", 1, "w last (TUM), or first (EuRoC)?"),
        ("1.5,1,2,0,0.8,0,0,0.6,9\n", 1, "such as `timestamp,x,y,z,qx,qy,qz,qw`, got 9"),
    ],
)
def test_names_file_and_line(tmp_path: Path, text: str, line: int, words: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(BadInput) as refused:
        read_trajectory(path)
    assert str(refused.value).startswith(f"{path}:{line}: ")
    assert words in str(refused.value)


def test_refuses_missing_empty_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such file"):
        read_trajectory(tmp_path / "missing.tum")
    with pytest.raises(BadInput, match="no poses"):
        read_trajectory(written(tmp_path, ""))
    with pytest.raises(BadInput, match="cannot be read as text"):
        read_trajectory(written(tmp_path, b"\xff\xfe\x00\x80"))


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("1403636579763555584 1 2 0 0 0 0.6 0.8\n", 1403636579763555584),
        ("1403636579763555584.000000 1 2 0 0 0 0.6 0.8\n", 1403636579763555584),
        ("1.403636579763555e+18 1 2 0 0 0 0.6 0.8\n", 1403636579763555000),
        ("1403636579.763555584 1 2 0 0 0 0.6 0.8\n", 1403636579763555584),
        ("timestamp tx ty tz qx qy qz qw\n1403636579.763555584 1 2 0 0 0 0.6 0.8\n",
         1403636579763555584),
        ("num,t,x,y,z,qx,qy,qz,qw\n7,12.5,1,2,0,0,0,0.6,0.8\n", 12_500_000_000),
        ("qw;qx;qy;qz;y;x;time [ms]\n0.8;0;0;0.6;2;1;1500\n", 1_500_000_000),
        ("%time,field.header.seq,field.pose.position.x,field.pose.position.y,"
         "field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,"
         "field.pose.orientation.z,field.pose.orientation.w\n"
         "1403636579763555584,4,1,2,0,0,0,0.6,0.8\n", 1403636579763555584),
        ("#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [],"
         " q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1]\n5000000000,1,2,0,0.8,0,0,0.6,9\n",
         5_000_000_000),
        ("stamp.sec,stamp.nanosec,x,y,yaw\n3,5,1,2,1.2870022175866867\n", 3_000_000_005),
    ],
)  # fmt: skip
def test_units_and_columns_of_other_tools(tmp_path: Path, text: str, stamp_ns: int) -> None:
    path = read_trajectory(written(tmp_path, text))
    assert abs(int(path.stamps_ns[0]) - stamp_ns) < 300
    assert np.allclose(path.poses, [[1, 2, 2 * np.arctan2(0.6, 0.8)]])


def test_rows_that_are_not_numbers_are_left_out_with_one_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = "1 1 0 0 0 0 0 1\n2 nan nan nan nan nan nan nan\n3 inf 0 0 0 0 0 1\n4 4 0 0 0 0 0 1\n"
    path = read_trajectory(written(tmp_path, text))
    assert path.stamps_ns.tolist() == [1_000_000_000, 4_000_000_000]
    assert len(caplog.records) == 1
    assert "2 rows without finite numbers left out, the first in line 2" in caplog.text


def test_matrices_that_are_not_numbers_are_left_out_like_other_rows(tmp_path: Path) -> None:
    """Poses of KITTI's that were not known; the others keep their places in time."""
    good = "1 0 0 {} 0 1 0 8 0 0 1 0"
    rows = [good.format(7), " ".join(["nan"] * 12), good.format("inf"), good.format(9)]
    path = read_trajectory(written(tmp_path, "\n".join(rows)))
    assert path.stamps_ns.tolist() == [0, 3_000_000_000]
    assert path.poses[:, 0].tolist() == [7.0, 9.0]


def test_a_run_folder_stands_for_its_trajectory(tmp_path: Path) -> None:
    (tmp_path / "trajectory.tum").write_text("x")
    assert trajectory_file(tmp_path).name == "trajectory.tum"
    assert trajectory_file(tmp_path, truth=True).name == "trajectory.tum"
    (tmp_path / "ground_truth.tum").write_text("x")
    assert trajectory_file(tmp_path, truth=True).name == "ground_truth.tum"
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInput, match="is it a run folder"):
        trajectory_file(tmp_path / "empty")


def test_a_long_header_is_not_told_at_length(tmp_path: Path) -> None:
    header = "# timestamp x y z qx qy qz qw " + " ".join(f"more_{k}" for k in range(500))
    rest = " 0" * 500
    text = f"{header}\n0 0 0 0 0 0 0 1{rest}\n1 4 0 0 : 0 0 1{rest}\n"
    with pytest.raises(BadInput, match="expected lines") as refused:
        read_trajectory(written(tmp_path, text))
    assert len(str(refused.value).replace(str(tmp_path), "")) < 500


def test_yaw_of_a_tilted_body_is_where_its_x_axis_points_seen_from_above() -> None:
    turns = Rotation.random(200, random_state=3)
    poses = np.column_stack([np.zeros((200, 3)), turns.as_quat()])
    flat = SpatialTrajectory(np.arange(200, dtype=np.int64), poses).in_xy()
    forward = turns.apply([1.0, 0.0, 0.0])
    assert np.allclose(flat.poses[:, 2], np.arctan2(forward[:, 1], forward[:, 0]), atol=1e-9)


def test_kitti_keeps_height_and_the_whole_turn(tmp_path: Path) -> None:
    """Rows are the upper three of [R t], here from scipy's matrices."""
    turns = Rotation.random(5, random_state=8)
    places = np.random.default_rng(8).uniform(-9.0, 9.0, (5, 3))
    rows = np.concatenate([turns.as_matrix(), places[:, :, None]], axis=2).reshape(5, 12)
    text = "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in rows)
    read = read_spatial(written(tmp_path, text))
    assert np.allclose(read.poses[:, :3], places, atol=1e-12)
    assert np.allclose((Rotation.from_quat(read.poses[:, 3:]) * turns.inv()).magnitude(), 0.0)


@pytest.mark.parametrize("stamp", [2**63, -(2**63) - 1024, 2**63 - 1024, -(2**63) + 1024])
def test_stamps_in_nanoseconds_fit_64_bits_or_are_refused(stamp: int) -> None:
    if abs(stamp) < 2**63:
        assert stamp_ns(str(stamp), "ns") == stamp
    else:
        with pytest.raises(ValueError, match="64 bits"):
            stamp_ns(str(stamp), "ns")


def test_a_whole_number_in_front_is_nanoseconds_in_euroc() -> None:
    """A stamp with a point may be seconds: that is told by how large they are."""
    state = ["1.5"] * 16
    assert columns_by_custom(["1403636579758555392", *state], commas=True).unit == "ns"
    assert columns_by_custom(["1403636579.75", *["2"] * 16], commas=True).unit == ""
