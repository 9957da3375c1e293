# SPDX-License-Identifier: Apache-2.0
"""Recordings in MCAP, read in bounded memory from anybody.

:func:`open_recording` takes a bare ``.mcap`` or a rosbag2 folder, split or damaged, with or without an index.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.mcap_file import McapFile, Piece
from cwmav_common.mcap_scan import MessageIndex
from cwmav_common.rosbag2 import folder_files

FEW_PIECES = 4


@dataclass(frozen=True)
class Topic:
    """One topic of a recording; `schema` is the embedded definition, empty when there is none."""

    name: str
    type_name: str
    schema: str
    encoding: str
    count: int


@dataclass(frozen=True)
class Message:
    """One message as recorded; the data is CDR."""

    topic: str
    type_name: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True)
class Batch:
    """The messages of one topic in one piece, in file order, for :class:`cwmav_common.cdr.Columns`."""

    topic: Topic
    log_times: NDArray[np.int64]
    buffer: NDArray[np.uint8]
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]


class Recording:
    """A recording opened for reading: one or more MCAP files taken as one.

    Attributes
    ----------
    path
        What was opened.
    metadata
        Named key-value sets of all files.
    """

    def __init__(self, path: Path, files: list[McapFile], notes: list[str]) -> None:
        self.path = path
        self._files = sorted(files, key=_first_time)
        self._notes = notes
        self.metadata: dict[str, dict[str, str]] = {}
        for file in self._files:
            self.metadata.update(file.contents.metadata)

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        for file in self._files:
            file.close()

    @property
    def problems(self) -> list[str]:
        """Sentences on missing or damaged parts, as far as read."""
        return self._notes + [sentence for file in self._files for sentence in file.damage]

    @property
    def files(self) -> list[Path]:
        """The MCAP files, in time order."""
        return [file.path for file in self._files]

    @property
    def indexed(self) -> bool:
        """True when every file has a complete summary."""
        return all(file.contents.indexed for file in self._files)

    @property
    def topics(self) -> dict[str, Topic]:
        """Topics by name; the counts of split files are added."""
        found: dict[str, Topic] = {}
        for file in self._files:
            for identifier, topic in _topics(file).items():
                count = file.contents.counts.get(identifier, 0)
                count += found[topic.name].count if topic.name in found else 0
                found[topic.name] = Topic(topic.name, topic.type_name, topic.schema, topic.encoding, count)
        return dict(sorted(found.items()))

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last log time [ns]; (0, 0) without messages."""
        pieces = [piece for file in self._files for piece in file.contents.pieces if piece.end_ns]
        if not pieces:
            return 0, 0
        return min(piece.start_ns for piece in pieces), max(piece.end_ns for piece in pieces)

    def pauses(self, longest_ns: int, budget: int = 64 << 20) -> list[tuple[int, int]]:
        """Find times without any message, longer than `longest_ns`: begin and end [ns].

        Taken from the times that every piece carries. A piece that lasts longer than the others may hold a
        pause: it is looked into, as long as such pieces are not more than `budget` bytes in all.
        """
        pieces = self._pieces_by_time(None, None)
        lengths = [piece.end_ns - piece.start_ns for piece, _ in pieces]
        usual = float(np.median(lengths)) if len(lengths) > FEW_PIECES else 0.0
        spans: list[tuple[int, int]] = []
        for (piece, file), length in zip(pieces, lengths, strict=True):
            suspicious = length > longest_ns and length > 1.5 * usual and piece.size <= budget
            if not suspicious:
                spans.append((piece.start_ns, piece.end_ns))
                continue
            budget -= piece.size
            times = np.sort(file.load(piece)[1].log_times)
            jumps = np.flatnonzero(np.diff(times) > longest_ns)
            edges = [0, *(jumps + 1).tolist(), len(times)]
            spans += [(int(times[a]), int(times[b - 1])) for a, b in pairwise(edges) if b > a]
        found: list[tuple[int, int]] = []
        last = min((begin for begin, _ in spans), default=0)
        for begin, end in sorted(spans):
            if begin - last > longest_ns:
                found.append((last, begin))
            last = max(last, end)
        return found

    def batches(self, topics: Iterable[str] | None = None) -> Iterator[Batch]:
        """Go through the recording piece by piece, in file order, the messages grouped by topic."""
        wanted = None if topics is None else set(topics)
        for file in self._files:
            for _, buffer, index in file.pieces():
                known = _topics(file)
                for identifier in np.unique(index.channels).tolist():
                    topic = known.get(identifier)
                    if topic is None:
                        file._report(f"messages of undeclared channel {identifier} are not used")
                    elif wanted is None or topic.name in wanted:
                        rows = np.flatnonzero(index.channels == identifier)
                        yield Batch(
                            topic, index.log_times[rows], buffer, index.starts[rows], index.lengths[rows]
                        )

    def messages(
        self, topics: Iterable[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Message]:
        """Go through the messages with ``start_ns <= log time < end_ns`` in order of log time.

        Messages of equal time keep the order of the file. Only pieces that overlap in time are in memory
        together.
        """
        wanted = None if topics is None else set(topics)
        queue: list[tuple[int, int, Iterator[Message], Message]] = []
        for order, (piece, file) in enumerate(self._pieces_by_time(start_ns, end_ns)):
            yield from _drain(queue, piece.start_ns)
            _push(queue, order, _piece_messages(file, piece, wanted, start_ns, end_ns))
        yield from _drain(queue, None)

    def _pieces_by_time(self, start_ns: int | None, end_ns: int | None) -> list[tuple[Piece, McapFile]]:
        pieces = [(piece, file) for file in self._files for piece in file.contents.pieces]
        if start_ns is not None:
            pieces = [(piece, file) for piece, file in pieces if piece.end_ns >= start_ns]
        if end_ns is not None:
            pieces = [(piece, file) for piece, file in pieces if piece.start_ns < end_ns]
        return sorted(pieces, key=lambda item: item[0].start_ns)


def open_recording(path: str | Path) -> Recording:
    """Open a bare ``.mcap`` file or a rosbag2 folder.

    Raises
    ------
    InputError
        Nothing is there, the folder holds no MCAP, or a file is something else; the message names it.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such recording; expected an .mcap file or a rosbag2 folder")
    names, notes = ([path], []) if path.is_file() else folder_files(path)
    with ExitStack() as opened:  # a file that is no MCAP closes those before it
        files = [opened.enter_context(closing(McapFile(name))) for name in names]
        opened.pop_all()
    return Recording(path, files, notes)


def _first_time(file: McapFile) -> int:
    return min((piece.start_ns for piece in file.contents.pieces if piece.end_ns), default=0)


def _topics(file: McapFile) -> dict[int, Topic]:
    found = {}
    for identifier, channel in file.contents.channels.items():
        schema = file.contents.schemas.get(channel.schema_id)
        embedded = schema is not None and schema.encoding == "ros2msg"
        text = schema.data.decode("utf-8", "replace") if schema is not None and embedded else ""
        name = schema.name if schema is not None else ""
        found[identifier] = Topic(channel.topic, name, text, channel.message_encoding, 0)
    return found


def _piece_messages(
    file: McapFile, piece: Piece, wanted: set[str] | None, start_ns: int | None, end_ns: int | None
) -> Iterator[Message]:
    buffer, index = file.load(piece)
    topics = {k: t for k, t in _topics(file).items() if wanted is None or t.name in wanted}
    for row in _rows(index, list(topics), start_ns, end_ns).tolist():
        topic = topics[int(index.channels[row])]
        begin = int(index.starts[row])
        data = buffer[begin : begin + int(index.lengths[row])].tobytes()
        yield Message(topic.name, topic.type_name, int(index.log_times[row]), data)


def _rows(
    index: MessageIndex, channels: list[int], start_ns: int | None, end_ns: int | None
) -> NDArray[np.int64]:
    keep = np.isin(index.channels, channels)
    if start_ns is not None:
        keep &= index.log_times >= start_ns
    if end_ns is not None:
        keep &= index.log_times < end_ns
    rows = np.flatnonzero(keep)
    return rows[np.argsort(index.log_times[rows], kind="stable")]


def _push(
    queue: list[tuple[int, int, Iterator[Message], Message]], order: int, messages: Iterator[Message]
) -> None:
    message = next(messages, None)
    if message is not None:
        heapq.heappush(queue, (message.log_time_ns, order, messages, message))


def _drain(
    queue: list[tuple[int, int, Iterator[Message], Message]], before_ns: int | None
) -> Iterator[Message]:
    while queue and (before_ns is None or queue[0][0] < before_ns):
        _, order, messages, message = heapq.heappop(queue)
        yield message
        _push(queue, order, messages)
