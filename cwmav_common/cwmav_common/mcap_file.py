# SPDX-License-Identifier: Apache-2.0
"""One MCAP file, whole or damaged: where its pieces are, and each piece on demand.

With an intact summary nothing but the summary is read. Without one the record headers are walked once. Only
one piece (a chunk, or a window of loose messages) is in memory at a time, so the size of a recording does
not matter.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, Metadata, Schema
from mcap.stream_reader import CRCValidationError
from mcap.summary import Summary
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.mcap_scan import RECORD_HEADER, MessageIndex, scan

MAGIC = b"\x89MCAP0\r\n"
WINDOW = 4 << 20  # bytes of loose messages held at once
LARGEST_PIECE = (
    1 << 30
)  # a chunk that claims to be larger is taken as damage, not as a reason to fill the memory
# What a damaged summary or record can make the parser raise.
_DAMAGE = (
    McapError,
    CRCValidationError,
    struct.error,
    ValueError,
    OverflowError,
    MemoryError,
    OSError,
    KeyError,
)

_HEADER, _FOOTER, _CHUNK, _METADATA, _DATA_END = 0x01, 0x02, 0x06, 0x0C, 0x0F
_CHUNK_HEAD = struct.Struct(
    "<QQQII"
)  # start time, end time, uncompressed size, CRC, length of the compression name


@dataclass(frozen=True)
class Piece:
    """A chunk, or a window of loose messages (compression None): place in the file and log times [ns]."""

    offset: int
    size: int
    start_ns: int
    end_ns: int
    compression: str | None
    uncompressed: int = 0
    crc: int = 0


@dataclass
class Contents:
    """What a file holds; filled from the summary or by walking."""

    pieces: list[Piece] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    profile: str = ""
    indexed: bool = False


class McapFile:
    """A file opened for reading.

    Raises
    ------
    InputError
        There is no such file or it is no MCAP; the message names it and says what it is.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._stream = _open(self.path)
        self.size = self.path.stat().st_size
        self.contents = self._from_summary() or self._walk()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    @property
    def damage(self) -> list[str]:
        """Sentences on what is missing or broken, found so far; reading every piece finds the rest."""
        return self.contents.damage

    def load(self, piece: Piece) -> tuple[NDArray[np.uint8], MessageIndex]:
        """Read one piece: its bytes and the index of its messages; empty when it cannot be saved."""
        raw = _read_at(self._stream, piece.offset, piece.size)
        data = raw if piece.compression is None else self._inflate(piece, raw)
        buffer = np.frombuffer(data, np.uint8)
        index = scan(buffer)
        if not index.clean:
            self._report(f"{len(buffer) - index.end} bytes of a cut or damaged record at byte {piece.offset}")
        self._learn(buffer, index)
        return buffer, index

    def pieces(self) -> Iterator[tuple[Piece, NDArray[np.uint8], MessageIndex]]:
        """Go through all pieces in file order."""
        for piece in self.contents.pieces:
            yield (piece, *self.load(piece))

    def _report(self, sentence: str) -> None:
        text = f"{self.path}: {sentence}"
        if text not in self.contents.damage:
            self.contents.damage.append(text)

    # --- with a summary ------------------------------------------------------------------------------------

    def _from_summary(self) -> Contents | None:
        self._stream.seek(0)
        try:
            reader = SeekingReader(self._stream, validate_crcs=True, record_size_limit=LARGEST_PIECE)
            summary = reader.get_summary()
            if summary is None or not _complete(summary):
                return None
            profile = reader.get_header().profile
            metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
        except _DAMAGE:
            return None
        pieces = [_piece_of(self._stream, index) for index in summary.chunk_indexes]
        statistics = summary.statistics
        counts = dict(statistics.channel_message_counts) if statistics else {}
        return Contents(
            pieces=sorted((p for p in pieces if p is not None), key=lambda piece: piece.offset),
            schemas=dict(summary.schemas),
            channels=dict(summary.channels),
            metadata=metadata,
            counts=counts,
            profile=profile,
            indexed=True,
        )

    # --- without
    # ---------------------------------------------------------------------------------------------

    def _walk(self) -> Contents:
        self.contents = found = Contents()
        position = len(MAGIC)
        while position < self.size:
            head = _read_at(self._stream, position, RECORD_HEADER)
            if len(head) < RECORD_HEADER:
                self._report(f"ends within a record at byte {position} of {self.size}")
                break
            opcode, length = head[0], int.from_bytes(head[1:], "little")
            content = position + RECORD_HEADER
            if opcode in (_DATA_END, _FOOTER):
                self._report("has no complete index; all of it was read instead")
                break
            if opcode == 5:
                position = self._loose(position)
                continue
            if opcode == 0 or length > self.size - content:
                position = self._cut(opcode, position)
                break
            self._take(opcode, content, length, found)
            position = content + length
        else:
            self._report("has no end mark; the recorder did not close it")
        self._count_messages()
        return found

    def _cut(self, opcode: int, position: int) -> int:
        content = position + RECORD_HEADER
        if opcode == _CHUNK:
            self._chunk(content, self.size - content, self.contents)
        self._report(f"ends or is damaged at byte {position} of {self.size}, within a record")
        return self.size

    def _take(self, opcode: int, content: int, length: int, found: Contents) -> None:
        if opcode == _CHUNK:
            self._chunk(content, length, found)
        elif opcode in (_HEADER, 3, 4, _METADATA):
            data = _read_at(self._stream, content, length)
            try:
                self._record(opcode, ReadDataStream(io.BytesIO(data)), found)
            except _DAMAGE as error:
                self._report(
                    f"record at byte {content - RECORD_HEADER} cannot be read ({type(error).__name__})"
                )

    @staticmethod
    def _record(opcode: int, stream: ReadDataStream, found: Contents) -> None:
        if opcode == _HEADER:
            found.profile = stream.read_prefixed_string()
        elif opcode == 3:
            schema = Schema.read(stream)
            found.schemas.setdefault(schema.id, schema)
        elif opcode == 4:
            channel = Channel.read(stream)
            found.channels.setdefault(channel.id, channel)
        else:
            record = Metadata.read(stream)
            found.metadata[record.name] = dict(record.metadata)

    def _chunk(self, content: int, length: int, found: Contents) -> None:
        piece = _parse_chunk(self._stream, content, length)
        if piece is None:
            self._report(f"chunk at byte {content - RECORD_HEADER} has no readable head")
        else:
            found.pieces.append(piece)

    def _loose(self, position: int) -> int:
        """Split a run of messages outside of chunks into windows; give the position after it."""
        window = WINDOW
        while position < self.size:
            data = np.frombuffer(_read_at(self._stream, position, window), np.uint8)
            index = scan(data, only_messages=True)
            if index.end == 0:
                if index.clean:
                    return position
                if position + len(data) >= self.size or window >= LARGEST_PIECE:
                    self._report(f"ends within a message at byte {position} of {self.size}")
                    return self.size
                window *= 4
                continue
            times = index.log_times
            span = (int(times.min()), int(times.max())) if len(times) else (0, 0)
            self.contents.pieces.append(Piece(position, index.end, *span, compression=None))
            position += index.end
            window = WINDOW
        return position

    def _count_messages(self) -> None:
        counts: dict[int, int] = {}
        for _, _, index in self.pieces():
            ids, numbers = np.unique(index.channels, return_counts=True)
            for channel, number in zip(ids.tolist(), numbers.tolist(), strict=True):
                counts[channel] = counts.get(channel, 0) + number
        self.contents.counts = counts

    def _learn(self, buffer: NDArray[np.uint8], index: MessageIndex) -> None:
        """Take schemas and channels that only stand inside of chunks."""
        if self.contents_known:
            return
        for position in index.others.tolist():
            length = int.from_bytes(buffer[position + 1 : position + RECORD_HEADER].tobytes(), "little")
            content = position + RECORD_HEADER
            stream = ReadDataStream(io.BytesIO(buffer[content : content + length].tobytes()))
            try:
                self._record(int(buffer[position]), stream, self.contents)
            except _DAMAGE as error:
                self._report(f"schema or channel record cannot be read ({type(error).__name__})")

    @property
    def contents_known(self) -> bool:
        """True when the summary gave all schemas and channels."""
        return self.contents.indexed

    # --- chunk data
    # --------------------------------------------------------------------------------------------

    def _inflate(self, piece: Piece, raw: bytes) -> bytes:
        place = f"chunk at byte {piece.offset}"
        if piece.uncompressed > LARGEST_PIECE:
            self._report(f"{place} claims {piece.uncompressed} bytes; left out")
            return b""
        try:
            data, whole = _decompress(piece.compression or "", raw, piece.uncompressed)
        except _DAMAGE as error:
            self._report(f"{place} cannot be decompressed ({error}); its messages are lost")
            return b""
        except (zstandard.ZstdError, RuntimeError) as error:
            self._report(f"{place} cannot be decompressed ({error}); its messages are lost")
            return b""
        if not whole:
            self._report(f"{place} is cut; {len(data)} of {piece.uncompressed} bytes were saved")
        elif piece.crc and zlib.crc32(data) != piece.crc:
            self._report(f"{place} has a wrong checksum; its messages are not used")
            return b""
        return data


def _open(path: Path) -> BinaryIO:
    try:
        stream = path.open("rb")
        head = stream.read(16)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror or error}); expected an .mcap file"
        ) from None
    if head.startswith(MAGIC):
        return stream
    stream.close()
    raise InputError(f"{path}: is not an MCAP file ({_describe(head)})")


def _describe(head: bytes) -> str:
    if not head:
        return "it is empty"
    if head.startswith(b"SQLite format 3"):
        return "it is a SQLite database, the older rosbag2 storage; `ros2 bag convert` makes MCAP of it"
    if head.startswith(b"#ROSBAG"):
        return "it is a ROS 1 bag; convert it to MCAP first"
    if head.startswith(b"\x28\xb5\x2f\xfd"):
        return "it is a zstd-compressed file; decompress it with `zstd -d` first"
    return f"it starts with {head[:8]!r}, an MCAP starts with {MAGIC!r}"


def _read_at(stream: BinaryIO, position: int, size: int) -> bytes:
    stream.seek(position)
    return stream.read(max(size, 0))


def _complete(summary: Summary) -> bool:
    """Say whether the summary leads to every message: all chunks indexed and none outside of chunks."""
    statistics = summary.statistics
    if statistics is None or len(summary.chunk_indexes) != statistics.chunk_count:
        return False
    if statistics.message_count and not (summary.chunk_indexes and summary.channels):
        return False
    used = {c.schema_id for c in summary.channels.values()} - {0}
    return used <= set(summary.schemas)


def _piece_of(stream: BinaryIO, index: ChunkIndex) -> Piece | None:
    content = index.chunk_start_offset + RECORD_HEADER
    return _parse_chunk(stream, content, index.chunk_length - RECORD_HEADER)


def _parse_chunk(stream: BinaryIO, content: int, length: int) -> Piece | None:
    head = _read_at(stream, content, _CHUNK_HEAD.size + 64)
    if len(head) < _CHUNK_HEAD.size:
        return None
    start, end, uncompressed, crc, name_length = _CHUNK_HEAD.unpack_from(head)
    data = _CHUNK_HEAD.size + name_length + 8
    if name_length > 32 or len(head) < data:
        return None
    name = head[_CHUNK_HEAD.size : _CHUNK_HEAD.size + name_length].decode("ascii", "replace")
    size = int.from_bytes(head[data - 8 : data], "little")
    return Piece(content + data, min(size, length - data), start, end, name, uncompressed, crc)


def _decompress(compression: str, raw: bytes, size: int) -> tuple[bytes, bool]:
    """Give the data and whether it is whole; a cut piece gives what came before the cut."""
    if compression == "":
        return raw, len(raw) == size
    if compression == "zstd":
        inflater = zstandard.ZstdDecompressor().decompressobj()
        data = inflater.decompress(raw)
        return data, inflater.eof and len(data) == size
    if compression == "lz4":
        frame = lz4.frame.LZ4FrameDecompressor()
        data = frame.decompress(raw)
        return data, frame.eof and len(data) == size
    raise ValueError(f"unknown compression {compression!r}; readable are none, lz4 and zstd")
