# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Archives as Python's zipfile reads and writes them: contents, headers, and the end in 64 bits."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.files.npz import InParts, write_npz
from slarm_graph.files.zip_archive import ZipArchive


def archive_of(parts: dict[str, list[bytes | tuple[bytes, int]]]) -> bytes:
    """Files by name, each of pieces as they are, or of values so many times."""
    file = io.BytesIO()
    with ZipArchive(file) as archive:
        for name, pieces in parts.items():
            with archive.file(name) as entry:
                for piece in pieces:
                    if isinstance(piece, bytes):
                        assert entry.write(piece) == len(piece)
                    else:
                        entry.repeat(*piece)
    return file.getvalue()


def random_parts(seed: int) -> dict[str, list[bytes | tuple[bytes, int]]]:
    rng = np.random.default_rng(seed)
    return {
        f"file {k}.npy": [
            (rng.bytes(int(rng.integers(1, 9))), int(rng.integers(0, 3000)))
            if rng.random() < 0.5
            else rng.bytes(int(rng.integers(0, 500)))
            for _ in range(rng.integers(0, 6))
        ]
        for k in range(4)
    }


def contents(pieces: list[bytes | tuple[bytes, int]]) -> bytes:
    return b"".join(p if isinstance(p, bytes) else p[0] * p[1] for p in pieces)


@pytest.mark.parametrize("seed", range(5))
def test_zipfile_reads_what_was_written(seed: int) -> None:
    parts = random_parts(seed)
    with zipfile.ZipFile(io.BytesIO(archive_of(parts))) as theirs:
        assert theirs.testzip() is None
        found = {info.filename: theirs.read(info) for info in theirs.infolist()}
    expected = {name: contents(pieces) for name, pieces in parts.items()}
    assert found == expected


@pytest.mark.parametrize("seed", range(3))
def test_the_header_before_a_file_says_what_the_directory_says(seed: int) -> None:
    """Readers of a stream see it alone (APPNOTE 4.3.7, 4.5.3)."""
    data = archive_of(random_parts(seed))
    with zipfile.ZipFile(io.BytesIO(data)) as theirs:
        infos = theirs.infolist()
    for info in infos:
        head = struct.unpack_from("<IHHHHHIIIHH", data, info.header_offset)
        assert head[0] == 0x04034B50
        assert (head[3], head[6]) == (info.compress_type, info.CRC)
        assert head[7:9] == (0xFFFFFFFF, 0xFFFFFFFF)
        wide_at = info.header_offset + 30 + head[9]
        assert struct.unpack_from("<HHQQ", data, wide_at) == (
            1, 16, info.file_size, info.compress_size,
        )  # fmt: skip
    ends = [i.header_offset + 30 + len(i.filename) + 20 + i.compress_size
            for i in infos]  # fmt: skip
    assert [i.header_offset for i in infos] == [0, *ends[:-1]]


def test_the_end_is_that_of_zipfile_in_64_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The record and its locator, where zipfile is made to write them for a small archive, too."""
    ours = archive_of({"a": [b"xyz"], "b": [(b"q", 900)]})
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", 0)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", b"xyz")
        archive.writestr("b", b"q" * 900)
    ends = []
    for data in (ours, file.getvalue()):
        *record, size, begin = struct.unpack_from("<IQHHIIQQQQ", data, len(data) - 98)
        mark, disk, at, disks = struct.unpack_from("<IIQI", data, len(data) - 42)
        assert data[begin : begin + 4] == b"PK\x01\x02"
        assert begin + size == at == len(data) - 98
        ends.append((record, mark, disk, disks))
    assert ends[0] == ends[1]


def test_numpy_loads_arrays_in_parts_and_whole(tmp_path: Path) -> None:
    whole = np.arange(60, dtype=np.float32).reshape(5, 12)
    blank = np.full((7, 11), np.nan, dtype=np.float32)
    blank[3] = np.arange(11)
    parts = InParts((7, 11), blank.dtype, [33, blank[3], 33], np.nan)
    write_npz(tmp_path / "a.npz", [("whole", whole), ("parts", parts), ("turned", whole.T)])
    with np.load(tmp_path / "a.npz") as read:
        np.testing.assert_array_equal(read["whole"], whole)
        np.testing.assert_array_equal(read["parts"], blank)
        np.testing.assert_array_equal(read["turned"], whole.T)
    with pytest.raises(RuntimeError, match="bytes for an array"):
        write_npz(tmp_path / "b.npz", [("short", InParts((7, 11), blank.dtype, [76]))])


def test_an_archive_that_fails_half_way_has_no_end() -> None:
    file = io.BytesIO()
    with pytest.raises(RuntimeError), ZipArchive(file) as archive, archive.file("a") as entry:
        entry.write(b"x")
        raise RuntimeError
    assert not zipfile.is_zipfile(file)
