# SPDX-License-Identifier: Apache-2.0
"""Recordings in MCAP, written so that viewers open them as they are.

Profile ``ros2`` with embedded schemas, chunks, zstd, CRCs and a full index.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.writer import CompressionType, Writer

from cwmav_common import interfaces
from cwmav_common.errors import InputError

LIBRARY = "cwmav"
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


def _qos(latched: bool) -> str:
    durability = "transient_local" if latched else "volatile"
    return (
        f"- history: keep_last\n  depth: {1 if latched else 100}\n  reliability: reliable\n"
        f"  durability: {durability}\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n"
        "  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: automatic\n"
        "  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n"
        "  avoid_ros_namespace_conventions: false\n"
    )
