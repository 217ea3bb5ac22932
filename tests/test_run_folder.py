# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The run folder's contract: names, `latest`, whole files, the record."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from slarm_graph.app.progress import Quiet
from slarm_graph.app.run_folder import (
    RunFolder,
    create_run_folder,
    open_run_folder,
    read_record,
)
from slarm_graph.errors import BadInput, RunFailed


def test_a_new_folder_is_recorded_as_running_and_is_the_latest(tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path / "out")
    link = tmp_path / "out" / "latest"
    assert link.is_symlink()
    assert not link.readlink().is_absolute()
    assert link.resolve() == folder.path.resolve()
    record = json.loads((folder.path / "run.json").read_text())
    assert record["status"] == "running"
    assert {"wall_s", "cpu_s", "peak_memory_mb", "stages", "versions", "argv"} <= record.keys()


def test_the_record_names_the_revision_of_the_checkout(tmp_path: Path) -> None:
    checkout = Path(__file__).resolve().parents[1]
    command = ["git", "-C", str(checkout), "rev-parse", "HEAD"]
    if not (checkout / ".git").exists():
        pytest.skip("not in a checkout")
    head = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    noted = str(read_record(create_run_folder(tmp_path).path)["git_revision"])
    assert noted.removesuffix("-dirty") == head


def test_folders_of_one_second_get_numbers(tmp_path: Path) -> None:
    names = [create_run_folder(tmp_path).path.name for _ in range(3)]
    assert len(set(names)) == 3
    assert all(len(name.split("_")) in (2, 3) for name in names)


def test_a_file_is_whole_or_absent(tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path, "run")
    with pytest.raises(RuntimeError), folder.replacing("a.txt") as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert not (folder.path / "a.txt").exists()
    folder.write_text("a.txt", "whole")
    assert {p.name for p in folder.path.iterdir()} == {"run.json", "a.txt"}


def test_a_file_is_replaced_not_emptied(tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path, "run")
    folder.write_text("a.txt", "old")
    with folder.replacing("a.txt") as temporary:
        temporary.write_text("new")
        assert (folder.path / "a.txt").read_text() == "old"
    assert (folder.path / "a.txt").read_text() == "new"


def test_stages_are_timed_even_when_they_fail(tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path, "run")
    with pytest.raises(RuntimeError), folder.stage("slam", Quiet()):
        raise RuntimeError
    stages = read_record(folder.path)["stages"]
    assert isinstance(stages, dict)
    assert stages["slam"] >= 0.0


def test_results_are_only_replaced_on_wish_and_other_files_never(tmp_path: Path) -> None:
    create_run_folder(tmp_path, "run").write_text("trajectory.tum", "old")
    with pytest.raises(BadInput, match=r"already .running.; go on .* --overwrite"):
        create_run_folder(tmp_path, "run")
    assert (tmp_path / "run" / "trajectory.tum").read_text() == "old"
    folder = create_run_folder(tmp_path, "run", overwrite=True)
    assert not (folder.path / "trajectory.tum").exists()
    other = tmp_path / "thesis"
    other.mkdir()
    (other / "chapter.tex").write_text("years")
    with pytest.raises(BadInput, match="not a run"):
        create_run_folder(tmp_path, "thesis", overwrite=True)
    assert (other / "chapter.tex").read_text() == "years"


@pytest.mark.parametrize("name", ["latest", "..", "a/b"])
def test_odd_names_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(BadInput, match="plain folder name"):
        create_run_folder(tmp_path, name)


def test_a_place_that_cannot_be_written_is_refused_before_anything_else(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"cannot write to .*; choose a folder with --out"):
        create_run_folder(tmp_path / "file" / "out")


def test_a_name_that_is_too_long_is_what_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"--name a{300}: .*; choose a shorter one"):
        create_run_folder(tmp_path, "a" * 300)


def test_without_links_latest_is_a_text_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_args: object, **_options: object) -> None:
        raise OSError("no links here")

    monkeypatch.setattr(Path, "symlink_to", refuse)
    folder = create_run_folder(tmp_path)
    assert (tmp_path / "latest.txt").read_text() == f"{folder.path.name}\n"


def test_a_finished_run_is_not_taken_up_again(tmp_path: Path) -> None:
    create_run_folder(tmp_path, "run").note(wall_s_before=1)
    folder = open_run_folder(tmp_path / "run")
    assert folder.record()["wall_s_before"] == 1
    folder.note(status="ok")
    del folder
    with pytest.raises(BadInput, match="finished"):
        open_run_folder(tmp_path / "run")


@pytest.mark.parametrize("again", ["create", "open"])
def test_one_process_at_a_time_works_in_a_folder(tmp_path: Path, again: str) -> None:
    """Another process is refused while the first lives, and let in once it was killed."""
    hold = (
        "import sys, time; from pathlib import Path\n"
        "from slarm_graph.app.run_folder import create_run_folder\n"
        "folder = create_run_folder(Path(sys.argv[1]), 'run')\n"
        "print('here', flush=True); time.sleep(60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", hold, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "here\n"

    def take() -> RunFolder:
        if again == "open":
            return open_run_folder(tmp_path / "run")
        return create_run_folder(tmp_path, "run", overwrite=True)

    with pytest.raises(BadInput, match="another process is at work in"):
        take()
    process.kill()
    process.communicate()
    take()


@pytest.mark.parametrize("how", ["removed", "renamed", "replaced"])
def test_a_folder_that_vanishes_under_way_is_told(tmp_path: Path, how: str) -> None:
    folder = create_run_folder(tmp_path, "run")
    if how == "removed":
        shutil.rmtree(folder.path)
    else:
        folder.path.rename(tmp_path / "elsewhere")
    if how == "replaced":
        folder.path.mkdir()
    with pytest.raises(RunFailed, match="run was removed under way"):
        folder.write_text("trajectory.tum", "")


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="not a run folder"):
        open_run_folder(tmp_path)
