# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read rosbag2's SQLite files row by row; of a damaged file only the damaged rows are lost.

`rosbags` ends at the first damage and does not look at journals. Here an unfinished write is first
rolled back, in a copy, and of a damaged file the pages that are left are read one by one.
"""

from __future__ import annotations

import mmap
import shutil
import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief
from slarm_graph.frontends.recordings.recordings import Key, Losses, Stored
from slarm_graph.frontends.recordings.sqlite_pages import TableRow, message_rows
from slarm_graph.frontends.recordings.unpacking import MAX_CHUNK_BYTES, scratch_folder

MAGIC = b"SQLite format 3\0"
_JOURNALS = ("-wal", "-journal")
_BROKEN = (sqlite3.DatabaseError, OverflowError, MemoryError)


class Db3File:
    """The topics and messages of one file.

    Raises
    ------
    BadInput
        When it is no recording, or its table of topics is lost.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._told: list[str] = []
        self._losses = Losses()
        self._damaged = False
        try:
            self._database = self._open()
            self._topics = self._read_topics()
        except _BROKEN as error:
            raise BadInput(f"{path} is damaged: {brief(str(error))}") from None
        self.counts: dict[Key, int] = dict.fromkeys(self._topics.values(), 0)
        self.span_ns = (0, 0)
        self._count()

    def messages(self, wanted: Collection[Key]) -> Iterator[Stored]:
        """Yield the messages of some topics in the order of the file."""
        numbers = {number: key for number, key in self._topics.items() if key in set(wanted)}
        found = dict.fromkeys(wanted, 0)
        for row in self._rows(numbers):
            found[numbers[row.topic]] += 1
            yield numbers[row.topic], row.stamp_ns, row.data
        self._losses.note(found, self.counts, self.span_ns)

    def notices(self) -> list[str]:
        """Return notices: how the file is damaged, and which messages are lost so far."""
        return [*self._told, *self._losses.notices(self.path.name)]

    def _open(self) -> sqlite3.Connection:
        """Open read-only; with a journal beside it, a copy in which the journal was applied."""
        journals = [self.path.with_name(self.path.name + ending) for ending in _JOURNALS]
        journals = [file for file in journals if file.is_file() and file.stat().st_size]
        if journals:
            folder = scratch_folder(self)
            copies = [folder / file.name for file in (self.path, *journals)]
            for file, copy in zip((self.path, *journals), copies, strict=True):
                shutil.copyfile(file, copy)
            self._told.append(
                f"{journals[0].name} holds an unfinished write: completed or undone in a copy"
            )
            self._whole = copies[0]
            database = sqlite3.connect(self._whole)
        else:
            self._whole = self._whole_pages()
            uri = f"{self._whole.resolve().as_uri()}?mode=ro&immutable=1"
            database = sqlite3.connect(uri, uri=True)
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES)
        database.execute("PRAGMA trusted_schema=OFF")
        # Lets SQLite open a file that is shorter than its header says.
        database.execute("PRAGMA writable_schema=ON")
        database.text_factory = lambda raw: raw.decode("utf-8", "replace")
        return database

    def _whole_pages(self) -> Path:
        """Return the file, or a copy without a cut last page, which SQLite would fill with 0."""
        with self.path.open("rb") as file:
            size = int.from_bytes(file.read(18)[16:18], "big")
            size = 65536 if size == 1 else size
            total = self.path.stat().st_size
            if size < 512 or total % size == 0:
                return self.path
            copy = scratch_folder(self) / self.path.name
            file.seek(0)
            with copy.open("wb") as out:
                shutil.copyfileobj(file, out)
                out.truncate(total - total % size)
        return copy

    def _read_topics(self) -> dict[int, Key]:
        tables = self._database.execute(
            "SELECT name FROM sqlite_master WHERE type='table' AND name IN ('messages', 'topics')"
        ).fetchall()
        if len(tables) != 2:
            raise BadInput(f"{self.path} is no ROS 2 bag: a database without messages and topics")
        rows = self._database.execute("SELECT id, name, type FROM topics").fetchmany(100_000)
        return {
            number: (brief(name, 200), brief(kind, 200))
            for number, name, kind in rows
            if isinstance(number, int) and isinstance(name, str) and isinstance(kind, str)
        }

    def _count(self) -> None:
        first, last = [], []
        try:
            rows = self._database.execute(
                "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages"
                " GROUP BY topic_id"
            ).fetchall()
        except _BROKEN:
            self._damaged = True
            rows = self._count_by_reading()
        for number, count, start, end in rows:
            if number in self._topics and isinstance(start, int) and isinstance(end, int):
                self.counts[self._topics[number]] += count
                first.append(start)
                last.append(end)
        if first:
            self.span_ns = (min(first), max(last))
        if self._damaged:
            span_s = (self.span_ns[1] - self.span_ns[0]) * 1e-9
            left = count_of(sum(self.counts.values()), "message")
            self._told.append(
                f"warning: {self.path.name} is damaged or cut: rows that cannot be read are passed"
                f" over; left: {left}, over {span_s:.0f} s"
            )

    def _count_by_reading(self) -> list[tuple[int, int, int, int]]:
        found: dict[int, list[int]] = {}
        for row in self._salvaged():
            found.setdefault(row.topic, []).append(row.stamp_ns)
        return [(number, len(some), min(some), max(some)) for number, some in found.items()]

    def _rows(self, topics: Collection[int]) -> Iterator[TableRow]:
        """Yield the messages of topics in order; after damage those of the pages that are left."""
        chosen = ", ".join(str(int(number)) for number in topics) or "NULL"
        query = (
            "SELECT rowid, topic_id, timestamp, data FROM messages"
            f" WHERE topic_id IN ({chosen}) ORDER BY rowid"
        )
        last = -(2**63)
        if not self._damaged:
            try:
                for number, topic, stamp_ns, data in self._database.execute(query):
                    last = int(number)
                    if isinstance(stamp_ns, int) and isinstance(data, bytes):
                        yield TableRow(last, topic, stamp_ns, data)
                return
            except _BROKEN:
                self._damaged = True
        yield from (row for row in self._salvaged() if row.number > last and row.topic in topics)

    def _salvaged(self) -> list[TableRow]:
        """Every message in the pages of the file, in order, each once."""
        with (
            self._whole.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw,
        ):
            rows = {row.number: row for row in message_rows(raw) if row.topic in self._topics}
        return [rows[number] for number in sorted(rows)]
