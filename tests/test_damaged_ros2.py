# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cut and damaged mcap and db3 files give what is whole; hostile folders stay in their place."""

from __future__ import annotations

import shutil
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
from driven_bags import drive, noticed, opened, readings, told
from ros_bags import write_recording

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.ros2_recording import Ros2Recording
from slarm_graph.frontends.recordings.unpacking import unpack_partly

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


def lone_file(folder: Path, kind: str, *, scans: int = 60, compression: str = "") -> Path:
    made = write_recording(folder / "r", drive(kind, scans=scans), kind, compression=compression)
    return next(made.glob(f"*.{kind}"))


def messages(path: Path) -> list[bytes]:
    recording = Ros2Recording([path], path.name)
    out = []
    for _, packed in recording.read(recording.topics):
        spans = zip(packed.starts.tolist(), packed.ends.tolist(), strict=True)
        out += [packed.buffer[start:end].tobytes() for start, end in spans]
    return sorted(out)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_cut_file_gives_what_was_before_the_cut(tmp_path: Path, kind: str) -> None:
    path = lone_file(tmp_path, kind, scans=200)
    raw, whole = path.read_bytes(), messages(path)
    cut, found = tmp_path / f"cut.{kind}", []
    for share in (0.3, 0.5, 0.7, 0.9):
        cut.write_bytes(raw[: int(share * len(raw))])
        some = messages(cut)
        assert set(some) <= set(whole)
        found.append(len(some) / len(whole))
        assert found[-1] > share - 0.3
    assert found == sorted(found)
    assert "warning: cut" in noticed(cut)
    assert check(cut).exit_code == 1


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_damage_costs_little(tmp_path: Path, kind: str) -> None:
    path = lone_file(tmp_path, kind, scans=300)
    raw, whole, rng = path.read_bytes(), messages(path), np.random.default_rng(0)
    broken, shares = tmp_path / f"b.{kind}", []
    for at in rng.integers(100, len(raw) - 64, 40).tolist():
        data = bytearray(raw)
        data[at : at + 16] = rng.integers(0, 256, 16, np.uint8).tobytes()
        broken.write_bytes(data)
        try:
            shares.append(len(set(messages(broken)) & set(whole)) / len(whole))
        except BadInput:  # the table of topics, or of all messages, is hit
            shares.append(0.0)
    assert np.median(shares) > 0.95
    assert np.mean(np.array(shares) > 0.8) > 0.85


def test_what_an_mcap_has_lost_is_told(tmp_path: Path) -> None:
    path = lone_file(tmp_path, "mcap", scans=300)
    raw = bytearray(path.read_bytes())
    at = raw.find(b"base_link", len(raw) // 2)
    raw[at - 60 : at - 40] = b"\xff" * 20
    path.write_bytes(raw)
    source = opened(path)
    assert len(list(source)) < 300
    assert any("could not read 1 message, about" in notice for notice in source.info().notices)


@pytest.mark.parametrize("journal", ["wal", "delete"])
def test_a_db3_that_was_being_written_is_read(tmp_path: Path, journal: str) -> None:
    path = lone_file(tmp_path, "db3")
    whole = messages(path)
    database = sqlite3.connect(path, isolation_level=None)
    database.execute(f"PRAGMA journal_mode={journal}")
    database.execute("PRAGMA wal_autocheckpoint=0")
    database.execute("PRAGMA cache_size=2")
    database.execute("BEGIN")
    database.execute("DELETE FROM messages WHERE id > 60")
    database.execute("UPDATE messages SET data = zeroblob(20000)")
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in path.parent.glob("*.db3*"):  # as a crash leaves them
        shutil.copy(file, killed)
    database.execute("ROLLBACK")
    database.close()
    left = killed / path.name
    assert len(list(killed.iterdir())) >= 2
    assert messages(left) == whole
    assert "holds an unfinished write" in noticed(left)


def test_compressed_files_and_messages_without_metadata(tmp_path: Path) -> None:
    for mode in ("FILE", "MESSAGE"):
        for kind in ("db3", "mcap"):
            folder = tmp_path / f"{mode}{kind}"
            made = write_recording(folder, drive(kind), kind, compression=mode)
            lone = next(file for file in made.iterdir() if kind in file.name)
            assert len(readings(lone)) == 40
            (made / "metadata.yaml").unlink()
            assert len(readings(made)) == 40


def test_a_file_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap.zstd"
    path.write_bytes(zstd.compress(bytes(1 << 26)) * 3)
    assert "unpacks to more than" in told(path) or "is no ROS 2 bag" in told(path)
    assert len(unpack_partly(zstd.compress(bytes(1 << 24)), "zstd", 1000)) <= 1000
    assert unpack_partly(b"", "zstd", 1 << 40) == b""


@pytest.mark.parametrize("name", ["../secret.db3", "/etc/passwd", "a/../../b.db3"])
def test_metadata_cannot_name_files_outside_its_folder(tmp_path: Path, name: str) -> None:
    folder = write_recording(tmp_path / "r", drive("db3"), "db3")
    text = (folder / "metadata.yaml").read_text().replace("r.db3", name)
    (folder / "metadata.yaml").write_text(text)
    assert "names a file outside its folder" in told(folder)


def test_a_database_that_is_no_recording(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE messages (x)")
    database.execute(
        "CREATE VIEW topics AS WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t) "
        "SELECT n AS id, n AS name, n AS type FROM t"
    )
    database.commit()
    database.close()
    assert "a database without messages and topics" in told(path)


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_unrelated_recordings_are_not_one(tmp_path: Path, kind: str) -> None:
    paths = []
    for number, shift_s in enumerate((0.0, 4.0, 2e6)):
        messages = [(t, s + shift_s, m) for t, s, m in drive(kind)]
        made = write_recording(tmp_path / f"{number}.{kind}", messages, kind)
        paths.append(made if kind == "bag" else next(made.glob(f"*.{kind}")))
    text = told([paths[0], paths[2]])
    assert "are 556 h apart: recordings of their own" in text
    same = write_recording(tmp_path / f"same.{kind}", drive(kind, seed=3), kind)
    other = same if kind == "bag" else next(same.glob(f"*.{kind}"))
    assert "both hold /scan at the same time" in told([paths[0], other])


def test_a_folder_of_unrelated_bags_is_told(shared_data: Path) -> None:
    diagnosis = check(shared_data / "benchmark")
    assert diagnosis.exit_code == 2
    assert "recordings of their own" in diagnosis.text()


@pytest.mark.parametrize("name", ["mit-csail_db3", "dec13_target_before_mcap"])
def test_real_recordings_that_are_cut(shared_data: Path, tmp_path: Path, name: str) -> None:
    file = next(f for f in (shared_data / "ros2" / name).iterdir() if f.suffix in (".db3", ".mcap"))
    raw, whole = file.read_bytes(), len(messages(file))
    cut = tmp_path / file.name
    for share in (0.3, 0.6, 0.9):
        cut.write_bytes(raw[: int(share * len(raw))])
        assert len(messages(cut)) > (share - 0.15) * whole
