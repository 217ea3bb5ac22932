# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Chunks of ROS 1 bags: their places, and decompression as far as they are intact."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from slarm_graph.cores import usable_cores
from slarm_graph.frontends.recordings.packed import Bytes, Ints
from slarm_graph.frontends.recordings.ros1_records import Data
from slarm_graph.frontends.recordings.unpacking import MAX_CHUNK_BYTES, unpack_partly

_MOST_WORKERS = 4
"""Threads that decompress; every one holds a chunk of up to `MAX_CHUNK_BYTES`."""


@dataclass(slots=True)
class Chunk:
    """A chunk: place of its data, and per connection the offsets and record times of messages.

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
        """Return why it cannot be read; empty when it can."""
        if self.compression not in (b"none", b"bz2", b"lz4"):
            return f"compression {self.compression[:20].decode(errors='replace')!r} is unknown"
        if self.compression != b"none" and self.unpacked > MAX_CHUNK_BYTES:
            return f"a chunk claims to unpack to {self.unpacked / 1e6:.0f} MB"
        return ""


def unpacked(data: Data, chunks: Iterable[Chunk]) -> Iterator[tuple[Chunk, Bytes]]:
    """Decompress chunks in order, a few ahead of the consumer; damaged parts are missing."""
    workers = min(_MOST_WORKERS, usable_cores())
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


def _decompress(packed: bytes, chunk: Chunk) -> Bytes:
    """Decompress a chunk as far as it is intact, and no more than its stated size."""
    if chunk.problem():
        return np.zeros(0, np.uint8)
    kind = chunk.compression.decode("ascii")
    return np.frombuffer(unpack_partly(packed, kind, chunk.unpacked), np.uint8)
