# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Chunks of ROS 1 bags: where their data lie, and as much of them as can be decompressed."""

from __future__ import annotations

import bz2
import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Protocol, cast

import lz4.frame
import numpy as np

from slarm_graph.frontends.recordings.packed import Bytes, Ints
from slarm_graph.frontends.recordings.ros1_records import Data

MAX_CHUNK_BYTES = 1 << 27
"""128 MB decompressed: rosbag fills chunks to 768 kB unless told otherwise, and a chunk holds at
least one message. What claims more is damaged, or a trap that unpacks to gigabytes."""
_SLICE_BYTES = 1 << 16
"""Compressed bytes given to a decompressor at a time: what it made of the earlier ones is kept when
the next ones are damaged."""
_MOST_WORKERS = 4
"""Threads that decompress; every one holds a chunk of up to `MAX_CHUNK_BYTES`."""


@dataclass(slots=True)
class Chunk:
    """Where a chunk's data lie, and per connection the offsets and record times of its messages.

    Parameters
    ----------
    compression : bytes
    position, size : int
        In the file.
    unpacked : int
        Size after decompression, as the file says.
    index : dict of connection to (offsets, record times [ns])
        Empty where the file has none.
    whole : bool
        Whether all of its data are in the file.
    suspect : bool
        Whether the file is damaged behind it, where its index stands.
    """

    compression: bytes
    position: int
    size: int
    unpacked: int
    index: dict[int, tuple[Ints, Ints]] = field(default_factory=dict)
    whole: bool = True
    suspect: bool = False

    def problem(self) -> str:
        """Why it cannot be read at all; nothing when it can."""
        if self.compression not in (b"none", b"bz2", b"lz4"):
            return f"compression {self.compression[:20].decode(errors='replace')!r} is unknown"
        if self.compression != b"none" and self.unpacked > MAX_CHUNK_BYTES:
            return f"a chunk claims to unpack to {self.unpacked / 1e6:.0f} MB"
        return ""


def unpacked(data: Data, chunks: Iterable[Chunk]) -> Iterator[tuple[Chunk, Bytes]]:
    """Decompress chunks in order, a few ahead of the consumer; what is damaged is missing."""
    workers = min(_MOST_WORKERS, _usable_cores())
    pending: deque[tuple[Chunk, Future[Bytes]]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        for chunk in chunks:
            packed = data[chunk.position : chunk.position + chunk.size]
            pending.append((chunk, pool.submit(_decompress, packed, chunk)))
            if len(pending) > workers:
                ready, future = pending.popleft()
                yield ready, future.result()
        while pending:
            ready, future = pending.popleft()
            yield ready, future.result()


def _usable_cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Decompressor(Protocol):
    """What bz2 and lz4 offer alike."""

    eof: bool

    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def _decompress(packed: bytes, chunk: Chunk) -> Bytes:
    """Decompress as much of a chunk as is whole, and no more than it says it holds."""
    if chunk.problem():
        return np.zeros(0, np.uint8)
    if chunk.compression == b"none":
        return np.frombuffer(packed, np.uint8)
    kinds = {b"bz2": bz2.BZ2Decompressor, b"lz4": lz4.frame.LZ4FrameDecompressor}
    machine = cast(_Decompressor, kinds[chunk.compression]())
    parts: list[bytes] = []
    missing = chunk.unpacked
    for at in range(0, len(packed), _SLICE_BYTES):
        try:
            part = machine.decompress(packed[at : at + _SLICE_BYTES], max(missing, 1))
        except (OSError, EOFError, RuntimeError, ValueError):
            break
        parts.append(part)
        missing -= len(part)
        if machine.eof or missing <= 0:
            break
    return np.frombuffer(b"".join(parts), np.uint8)
