# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 recordings, sqlite3 and mcap, as topics of serialized messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath

from slarm_graph.errors import BadInput, brief
from slarm_graph.files.yaml_text import read_yaml
from slarm_graph.frontends.recordings.db3_file import MAGIC as SQLITE_MAGIC
from slarm_graph.frontends.recordings.db3_file import Db3File
from slarm_graph.frontends.recordings.mcap_file import MAGIC as MCAP_MAGIC
from slarm_graph.frontends.recordings.mcap_file import McapFile
from slarm_graph.frontends.recordings.packed import Packed, pack
from slarm_graph.frontends.recordings.recordings import (
    Key,
    Part,
    Storage,
    Topic,
    check_parts_of_one,
    first_bytes,
    topics_of,
)
from slarm_graph.frontends.recordings.unpacking import (
    ZSTD_MAGIC,
    scratch_folder,
    unpack_file,
    unpack_message,
)

_BATCH = 4096
"""Messages of a topic decoded at once: some megabytes of scans."""
METADATA = "metadata.yaml"
_INFORMATION = "rosbag2_bagfile_information"


class Ros2Recording:
    """A ROS 2 recording: one or several storage files, compressed or not.

    Parameters
    ----------
    paths : sequence of Path
    label : str
        Name of the recording, for messages.
    notices : iterable of str
        Notices so far.
    """

    cdr = True

    def __init__(self, paths: Sequence[Path], label: str, notices: Iterable[str] = ()) -> None:
        self.description = f"ROS 2 bag {label}"
        self._told = tuple(notices)
        self._files = [self._opened(path) for path in paths]
        self._files.sort(key=lambda file: file.span_ns)
        check_parts_of_one([(f.path.name, f.span_ns, set(f.counts)) for f in self._files])
        found: dict[Key, list[Part]] = {}
        for file in self._files:
            for key, count in file.counts.items():
                found.setdefault(key, []).extend([(count, file.span_ns)] if count else [])
        self.topics = topics_of(found)
        if not any(topic.count for topic in self.topics):
            state = "; ".join(notice.removeprefix("warning: ") for notice in self.notices)
            tool = "mcap recover" if isinstance(self._files[0], McapFile) else "sqlite3 .recover"
            told = f" ({state}); try: {tool}" if state else ""
            raise BadInput(f"{label} holds no messages{told}")

    @property
    def notices(self) -> tuple[str, ...]:
        """Return notices on damaged files; complete once the messages have been read."""
        return (*self._told, *(notice for file in self._files for notice in file.notices()))

    def read(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Packed]]:
        """Yield the messages of the topics in batches, in recorded order."""
        wanted = {(topic.name, topic.msgtype): topic for topic in topics}
        for file in self._files:
            held: dict[Key, list[tuple[int, bytes]]] = {key: [] for key in wanted}
            for key, record_ns, raw in file.messages(wanted):
                held[key].append((record_ns, unpack_message(raw)))
                if len(held[key]) == _BATCH:
                    yield wanted[key], pack(held[key])
                    held[key] = []
            for key, batch in held.items():
                if batch:
                    yield wanted[key], pack(batch)

    def _opened(self, path: Path) -> Storage:
        """Open a storage file by its content; a compressed one in a temporary folder."""
        start = first_bytes(path)
        if start.startswith(ZSTD_MAGIC):
            plain = scratch_folder(self) / path.name.removesuffix(".zstd")
            unpack_file(path, plain)
            path, start = plain, first_bytes(plain)
        if start.startswith(MCAP_MAGIC):
            return McapFile(path)
        if start.startswith(SQLITE_MAGIC):
            return Db3File(path)
        raise BadInput(f"{path} is no ROS 2 bag (first bytes {start[:8].decode('latin-1')!a})")


def listed_files(folder: Path) -> list[Path]:
    """Return the storage files that a folder's metadata.yaml names; empty where it is unusable.

    (`ros2 bag reindex` may leave it incomplete, and files are renamed without it.)

    Raises
    ------
    BadInput
        When it names files outside the folder.
    """
    try:
        content = read_yaml(folder / METADATA).content
    except BadInput:
        return []
    information = content.get(_INFORMATION) if isinstance(content, dict) else None
    names = information.get("relative_file_paths") if isinstance(information, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return []
    found = []
    for name in names:
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts or "\0" in name:
            raise BadInput(f"{folder / METADATA} names a file outside its folder: {brief(name)}")
        # Up to version 3 the names began with the folder's own.
        inside = [file for file in (folder / place, folder / place.name) if file.is_file()]
        if not inside:
            return []
        found.append(inside[0])
    return found
