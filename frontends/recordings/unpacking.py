# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounded decompression, also of damaged data as far as they are intact."""

from __future__ import annotations

import bz2
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, cast

import lz4.frame

from slarm_graph.errors import BadInput

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAX_CHUNK_BYTES = 1 << 27
"""128 MB decompressed: rosbag fills chunks to 768 kB unless told otherwise, rosbag2 to 4 MB, and a
chunk holds at least one message. What claims more is damaged, or a trap that unpacks to GB."""
_SLICE_BYTES = 1 << 16
"""Compressed bytes given to a decompressor at a time: what it made of the earlier ones is kept when
the next ones are damaged."""
MAX_RATIO = 200
"""Largest compression ratio of a file; scans are packed to a fifth or so, an empty costmap to a
hundredth."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class _Decompressor(Protocol):
    """The common interface of the bz2, lz4 and zstd decompressors."""

    eof: bool

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """Decompress the next part, to at most `max_length` bytes."""
        ...


_KINDS = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
_FAILURES = (OSError, EOFError, RuntimeError, ValueError, zstd.ZstdError, MemoryError)


def unpack_partly(packed: bytes, compression: str, claimed: int) -> bytes:
    """Decompress as far as the data are intact, and no more than the claimed size.

    Parameters
    ----------
    packed : bytes
    compression : str
        `bz2`, `lz4`, `zstd`; empty or `none` for none.
    claimed : int
        Size after decompression; more than `MAX_CHUNK_BYTES` gives nothing.
    """
    if compression in ("", "none"):
        return packed
    if compression not in _KINDS or claimed > MAX_CHUNK_BYTES:
        return b""
    machine = cast(_Decompressor, cast(Callable[[], object], _KINDS[compression])())
    parts: list[bytes] = []
    missing = claimed
    for at in range(0, len(packed), _SLICE_BYTES):
        try:
            part = machine.decompress(packed[at : at + _SLICE_BYTES], max(missing, 1))
        except _FAILURES:
            break
        parts.append(part)
        missing -= len(part)
        if machine.eof or missing <= 0:
            break
    return b"".join(parts)


def scratch_folder(owner: object) -> Path:
    """Make a temporary folder that is removed with its owner."""
    folder = tempfile.mkdtemp(prefix="slarm-")
    weakref.finalize(owner, shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def unpack_message(raw: bytes) -> bytes:
    """Decompress a single message (rosbag2's mode `message`), recognised by its first bytes."""
    if not raw.startswith(ZSTD_MAGIC):
        return raw
    return unpack_partly(raw, "zstd", min(MAX_RATIO * len(raw) + 4096, MAX_CHUNK_BYTES))


def unpack_file(path: Path, destination: Path) -> None:
    """Decompress a file that is compressed as a whole (rosbag2's mode `file`).

    Raises
    ------
    BadInput
        When it is damaged before its first bytes, or unpacks to more than a recording does or than
        the disk holds.
    """
    most = MAX_RATIO * path.stat().st_size + (1 << 20)
    free = shutil.disk_usage(destination.parent).free // 2
    done, machine = 0, zstd.ZstdDecompressor()
    with path.open("rb") as packed, destination.open("wb") as out:
        while not machine.eof and (part := packed.read(_SLICE_BYTES)):
            try:
                plain = machine.decompress(part, 1 << 24)
                done += out.write(plain)
                while not machine.eof and not machine.needs_input and done <= min(most, free):
                    done += out.write(machine.decompress(b"", 1 << 24))
            except _FAILURES:
                break
            if done > min(most, free):
                raise BadInput(
                    f"{path} unpacks to more than {min(most, free) / 1e6:.0f} MB; unpack it"
                    f" yourself if that is right: zstd -d {path.name}"
                )
    if not done:
        raise BadInput(f"{path} is compressed, and damaged")
