# SPDX-License-Identifier: Apache-2.0
"""Recordings in MCAP: written so that viewers open them as they are, read in bounded memory from anybody.

:class:`BagWriter` writes profile ``ros2`` with embedded schemas, chunks, zstd, CRCs and a full index.
:func:`open_recording` takes a bare ``.mcap`` or a rosbag2 folder, split or damaged, with or without an index.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_file import McapFile, Piece
from cwmav_common.mcap_scan import MessageIndex

LIBRARY = "cwmav"
FEW_PIECES = 4
_COMPRESSION = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


class BagWriter:
    """Write one MCAP file of ROS 2 messages.

    The file is complete after :meth:`close`; use it as a context manager.

    Parameters
    ----------
    path
        File to write; its folder must exist.
    compression
        ``zstd``, ``lz4`` or ``none``.
    chunk_size
        Bytes per chunk before compression. Small chunks make seeking quick, large ones compress better.
    """

    def __init__(self, path: str | Path, *, compression: str = "zstd", chunk_size: int = 1 << 20) -> None:
        if compression not in _COMPRESSION:
            raise InputError(f"compression {compression!r}; allowed: {', '.join(_COMPRESSION)}")
        self.path = Path(path)
        try:
            self._stream = self.path.open("wb")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error})") from None
        self._writer = Writer(self._stream, chunk_size=chunk_size, compression=_COMPRESSION[compression])
        self._writer.start(profile="ros2", library=LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str]] = {}
        self._sequence: dict[str, int] = {}
        self._closed = False

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self.close()

    def add_topic(self, topic: str, type_name: str, *, latched: bool = False) -> None:
        """Declare a topic; done at the first write otherwise."""
        if topic in self._channels:
            return
        if type_name not in self._schemas:
            text = interfaces.schema_text(type_name).encode()
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text)
        metadata = {
            "offered_qos_profiles": _qos(latched),
            "topic_type_hash": interfaces.type_hash(type_name),
        }
        channel = self._writer.register_channel(topic, "cdr", self._schemas[type_name], metadata)
        self._channels[topic] = (channel, type_name)

    def write(
        self, topic: str, type_name: str, message: Any, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Write a message object; `log_time_ns` is when it was received."""
        self.write_raw(
            topic, type_name, interfaces.serialise(message, type_name), log_time_ns, publish_time_ns
        )

    def write_raw(
        self, topic: str, type_name: str, cdr: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Write a message that is CDR already."""
        self.add_topic(topic, type_name)
        channel, declared = self._channels[topic]
        if declared != type_name:
            raise InputError(f"topic {topic} carries {declared}, not {type_name}")
        sequence = self._sequence.get(topic, 0)
        self._sequence[topic] = sequence + 1
        published = log_time_ns if publish_time_ns is None else publish_time_ns
        self._writer.add_message(channel, int(log_time_ns), cdr, int(published), sequence)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named set of key-value pairs about the recording."""
        self._writer.add_metadata(name, {str(key): str(value) for key, value in values.items()})

    def close(self) -> None:
        """Finish the file: last chunk, index, footer."""
        if not self._closed:
            self._closed = True
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.close()


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
    names, notes = ([path], []) if path.is_file() else _folder_files(path)
    with ExitStack() as opened:  # a file that is no MCAP closes those before it
        files = [opened.enter_context(closing(McapFile(name))) for name in names]
        opened.pop_all()
    return Recording(path, files, notes)


def _folder_files(folder: Path) -> tuple[list[Path], list[str]]:
    described = folder / "metadata.yaml"
    present = sorted(folder.glob("*.mcap"))
    if not described.exists():
        if not present:
            raise InputError(f"{folder}: holds neither metadata.yaml nor an .mcap file")
        return present, [f"{folder}: has no metadata.yaml; the .mcap files in it are taken in order of time"]
    names = _described_files(described)
    paths = [folder / name for name in names]
    missing = [path for path in paths if not path.exists()]
    notes = [f"{path}: named in metadata.yaml but missing" for path in missing]
    found = [path for path in paths if path.exists()]
    if not found:
        raise InputError(
            f"{folder}: none of the files in metadata.yaml exists ({', '.join(names) or 'none named'})"
        )
    return found, notes


def _described_files(path: Path) -> list[str]:
    try:
        information = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        storage = str(information.get("storage_identifier", "mcap"))
        names = [str(name) for name in information["relative_file_paths"]]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is no rosbag2 description ({type(error).__name__}: {error})") from None
    if storage != "mcap":
        raise InputError(f"{path}: storage is {storage!r}; only 'mcap' is read (`ros2 bag convert` makes it)")
    return names


def write_rosbag2_metadata(
    folder: str | Path, recording: Recording, custom: Mapping[str, str] | None = None
) -> None:
    """Write the ``metadata.yaml`` (version 9) that makes `folder` a rosbag2 bag of the recording's files."""
    start, end = recording.span_ns
    topics = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": topic.encoding,
                "offered_qos_profiles": [],
                "type_description_hash": interfaces.type_hash(topic.type_name)
                if interfaces.known(topic.type_name)
                else "",
            },
            "message_count": topic.count,
        }
        for topic in recording.topics.values()
    ]
    times = {"duration": {"nanoseconds": end - start}, "starting_time": {"nanoseconds_since_epoch": start}}
    total = sum(topic.count for topic in recording.topics.values())
    files = [
        {"path": path.name, **_file_times(start, end), "message_count": total} for path in recording.files
    ]
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        **times,
        "message_count": total,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [path.name for path in recording.files],
        "files": files,
        "custom_data": dict(custom or {}),
        "ros_distro": "jazzy",
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
    (Path(folder) / "metadata.yaml").write_text(text, encoding="utf-8")


def _file_times(start: int, end: int) -> dict[str, Any]:
    return {"starting_time": {"nanoseconds_since_epoch": start}, "duration": {"nanoseconds": end - start}}


def _qos(latched: bool) -> str:
    durability = "transient_local" if latched else "volatile"
    return (
        f"- history: keep_last\n  depth: {1 if latched else 100}\n  reliability: reliable\n"
        f"  durability: {durability}\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n"
        "  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: automatic\n"
        "  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n"
        "  avoid_ros_namespace_conventions: false\n"
    )


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
