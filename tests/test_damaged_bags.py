# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A cut, damaged or unindexed ROS 1 bag loses the records that are damaged, and no more."""

from __future__ import annotations

import bz2
import resource
import struct
from pathlib import Path

import numpy as np
import pytest
from driven_bags import drive, told
from ros_bags import write_recording
from rosbags.rosbag1 import Reader, Writer

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.recordings import Ros1Recording
from slarm_graph.frontends.recordings.ros1_file import Ros1File
from slarm_graph.frontends.recordings.ros1_records import CHUNK, INDEX, record_at
from slarm_graph.frontends.recordings.sources import open_source

COMPRESSIONS = ["", "BZ2", "LZ4"]


def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make rosbags write chunks of a few messages, as a long recording has many."""
    init = Writer.__init__

    def initialise(self: Writer, path: Path) -> None:
        init(self, path)
        self.chunk_threshold = 3000

    monkeypatch.setattr(Writer, "__init__", initialise)


@pytest.fixture(params=COMPRESSIONS)
def bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    small_chunks(monkeypatch)
    path = tmp_path / "whole.bag"
    write_recording(path, drive(scans=60), compression=request.param)
    with Reader(path) as reader:
        assert len(reader.chunks) > 5
    return path


def messages(path: Path) -> list[bytes]:
    """Every scan and odometry message that is read."""
    recording = Ros1Recording([path])
    out = []
    for _, packed in recording.read(recording.topics):
        spans = zip(packed.starts.tolist(), packed.ends.tolist(), strict=True)
        out += [packed.buffer[start:end].tobytes() for start, end in spans]
    return sorted(out)


def chunk_ends(path: Path) -> list[tuple[int, int]]:
    """(end of the chunk in the file, number of its messages), by rosbags' reader."""
    with Reader(path) as reader:
        sizes = {pos: sum(info.connection_counts.values()) for pos, info in
                 ((c.pos, c) for c in reader.chunk_infos)}  # fmt: skip
    data = path.read_bytes()
    ends = []
    for position, count in sorted(sizes.items()):
        record = record_at(data, position)
        assert record is not None
        assert record.kind == CHUNK
        ends.append((record.end, count))
    return ends


def test_a_cut_bag_gives_every_whole_chunk_before_the_cut(bag: Path, tmp_path: Path) -> None:
    raw, whole, ends = bag.read_bytes(), messages(bag), chunk_ends(bag)
    cut = tmp_path / "cut.bag"
    for at in np.linspace(200, len(raw), 60).astype(int).tolist():
        cut.write_bytes(raw[:at])
        expected = sum(count for end, count in ends if end <= at)
        try:
            found = messages(cut)
        except BadInput as error:
            assert expected == 0, str(error)
            continue
        assert len(found) >= expected
        assert set(found) <= set(whole)
        assert len(found) <= expected + max(count for _, count in ends)


def test_a_damaged_byte_costs_one_chunk_at_most(bag: Path, tmp_path: Path) -> None:
    raw, whole, ends = bag.read_bytes(), messages(bag), chunk_ends(bag)
    most, rng = max(count for _, count in ends), np.random.default_rng(0)
    broken = tmp_path / "broken.bag"
    for at in rng.integers(4200, len(raw), 80).tolist():
        data = bytearray(raw)
        data[at] ^= int(rng.integers(1, 256))
        broken.write_bytes(data)
        found = messages(broken)
        assert len(set(found) & set(whole)) >= len(whole) - most, at


def test_what_was_lost_is_told_in_messages_and_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_chunks(monkeypatch)
    path = write_recording(tmp_path / "a.bag", drive(scans=60), compression="LZ4")
    raw = bytearray(path.read_bytes())
    end, count = chunk_ends(path)[3]
    raw[end - 40 : end - 20] = bytes(20)
    broken = tmp_path / "b.bag"
    broken.write_bytes(raw)
    source = open_source(broken, SourceConfig())
    notice = next(n for n in source.info().notices if "could not read" in n)
    assert f"b.bag is damaged: could not read {count} messages, about 0." in notice
    assert notice.startswith("warning: ")
    cut = tmp_path / "c.bag"
    cut.write_bytes(path.read_bytes()[: end + 200])
    told_cut = next(n for n in open_source(cut, SourceConfig()).info().notices if "early" in n)
    seconds = float(told_cut.split(" chunks, some ")[1].removesuffix(" s"))
    lost_s = 6.0 - 0.1 * len(list(open_source(cut, SourceConfig())))
    assert seconds == pytest.approx(lost_s, abs=1.5)
    assert check(cut).exit_code == 1


def test_an_unindexed_bag_is_read_whole(bag: Path, tmp_path: Path) -> None:
    data, out, at = bag.read_bytes(), bytearray(), 13
    while at < len(data):
        record = record_at(data, at)
        assert record is not None
        if record.kind == INDEX or (out and record.kind == b"\7"):
            at = record.end
            continue
        if record.kind == b"\6":
            break
        out += data[at : record.end]
        at = record.end
    active = tmp_path / "a.bag.active"
    active.write_bytes(data[:13] + out)
    assert messages(active) == messages(bag)


def bag_of(*chunks: tuple[bytes, bytes, int]) -> bytes:
    """A bag from (compression, data, claimed size) of chunks."""

    def record(fields: dict[str, bytes], data: bytes) -> bytes:
        head = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v
            for k, v in fields.items()
        )
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    start = {"op": b"\3", "index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": bytes(4)}
    out = b"#ROSBAG V2.0\n" + record(start, b" " * 4000)
    for compression, data, size in chunks:
        fields = {"op": b"\5", "compression": compression, "size": struct.pack("<I", size)}
        out += record(fields, data)
    return out


@pytest.mark.parametrize("claimed", [0, 100, 1 << 20, (1 << 32) - 1])
def test_a_chunk_that_unpacks_to_gigabytes_is_not_unpacked(tmp_path: Path, claimed: int) -> None:
    machine = bz2.BZ2Compressor(9)
    packed = b"".join(machine.compress(bytes(1 << 22)) for _ in range(4)) + machine.flush()
    path = tmp_path / "bomb.bag"
    path.write_bytes(bag_of((b"bz2", packed, claimed), (b"bz2", packed, claimed)))
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert "holds no messages" in told(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100_000


def test_an_unknown_compression_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(bag_of((b"xz", b"abc", 3)))
    assert "compression 'xz' is unknown" in told(path)


def test_lengths_of_four_gigabytes_are_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(bag_of((b"none", b"\xff\xff\xff\xff" * 50, 200)))
    assert "holds no messages" in told(path)
    path.write_bytes(b"#ROSBAG V2.0\n" + b"\xff\xff\xff\xff" + bytes(100))
    assert "holds no messages" in told(path)


@pytest.mark.parametrize(
    ("name", "scans"),
    [
        ("truncated_second_chunk", 318),
        ("length_past_chunk", 25),
        ("typeerror", 25),
    ],
)
def test_cases_keep_what_is_whole(shared_data: Path, name: str, scans: int) -> None:
    path = shared_data / f"cases/damaged/{name}.bag"
    assert len(list(open_source(path, SourceConfig()))) == scans


@pytest.mark.parametrize("name", ["bomb_bz2", "header_len_4GB"])
def test_cases_that_hold_nothing_are_refused(shared_data: Path, name: str) -> None:
    with pytest.raises(BadInput):
        open_source(shared_data / f"cases/damaged/{name}.bag", SourceConfig())


@pytest.mark.parametrize("name", ["robot_bags/dec13_target_before", "benchmark/fr079"])
def test_real_bags_that_are_cut(shared_data: Path, tmp_path: Path, name: str) -> None:
    raw = (shared_data / f"{name}.bag").read_bytes()
    whole = Ros1File(shared_data / f"{name}.bag")
    cut = tmp_path / "cut.bag"
    for share in (0.3, 0.6, 0.9):
        cut.write_bytes(raw[: int(share * len(raw))])
        part = Ros1File(cut)
        read = sum(len(packed) for _, packed in part.read(list(part.connections)))
        assert read > (share - 0.1) * sum(whole.counts().values())
