# SPDX-License-Identifier: Apache-2.0
"""Recordings made from other recordings: other types, other writers, damage."""

from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

from cwmav_common import interfaces
from cwmav_common.mcap_reader import Message, open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig.synthesis_settings import Artefacts, Instruments, Synthesis

SMALL = Synthesis(
    seconds=6.0,
    seed=3,
    artefacts=Artefacts(thermal=0.0),  # so that maps without the temperature of the sensor give the same
    instruments=Instruments(force_rate=2000.0, power_rate=2000.0, camera_rate=200.0, tare_seconds=0.2),
)
Translated = Iterable[tuple[str, str, Any]]


def translate(source: Path, target: Path, change: Callable[[Message, Any], Translated]) -> Path:
    """Rewrite a recording; `change` gives (topic, type, message) for every decoded message."""
    with open_recording(source) as recording, BagWriter(target) as bag:
        for message in recording.messages():
            decoded = interfaces.deserialise(message.data, message.type_name)
            for topic, type_name, content in change(message, decoded):
                bag.write(topic, type_name, content, message.log_time_ns)
    return target


def rewrite(source: Path, target: Path, *, metadata: bool = True, **options: Any) -> Path:
    """Copy a recording with the plain MCAP writer and its options (chunk size, compression, indexes)."""
    with open_recording(source) as recording, target.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start(profile="ros2", library="someone else")
        channels = {}
        for name, topic in recording.topics.items():
            schema = writer.register_schema(topic.type_name, "ros2msg", topic.schema.encode())
            channels[name] = writer.register_channel(name, "cdr", schema)
        if metadata:
            for name, values in recording.metadata.items():
                writer.add_metadata(name, values)
        for message in recording.messages():
            writer.add_message(
                channels[message.topic], message.log_time_ns, message.data, message.log_time_ns
            )
        writer.finish()
    return target


def split(source: Path, folder: Path, cuts: list[float]) -> Path:
    """Split a recording into several files of a rosbag2 folder at shares of its length."""
    folder.mkdir()
    with open_recording(source) as recording:
        begin, end = recording.span_ns
        edges = [begin, *(begin + int(cut * (end - begin)) for cut in cuts), end + 1]
        names = []
        for k, (low, high) in enumerate(pairwise(edges)):
            names.append(f"part_{k}.mcap")
            with BagWriter(folder / names[-1]) as bag:
                for name, values in recording.metadata.items():
                    bag.add_metadata(name, values)
                for message in recording.messages(start_ns=low, end_ns=high):
                    bag.write_raw(message.topic, message.type_name, message.data, message.log_time_ns)
    listed = "".join(f"\n    - {name}" for name in names)
    text = f"rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths:{listed}\n"
    (folder / "metadata.yaml").write_text(text)
    return folder


UNINDEXED = {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False}
BARE = {**UNINDEXED, "repeat_channels": False, "repeat_schemas": False}
WRITERS = {
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4 in small chunks": {"compression": CompressionType.LZ4, "chunk_size": 20_000},
    "uncompressed": {"compression": CompressionType.NONE},
    "no index": {"compression": CompressionType.ZSTD, **UNINDEXED},
    "no summary": {"compression": CompressionType.LZ4, **BARE},
    "no chunks": {"use_chunking": False},
    "no chunks, no summary": {"use_chunking": False, **BARE},
}


def scalars(topic: str, values: np.ndarray, stamps_ns: np.ndarray) -> Translated:
    """Give ScalarStamped messages of an array."""
    for stamp, value in zip(stamps_ns.tolist(), values.tolist(), strict=True):
        message = interfaces.new(
            "cwmav_msgs/msg/ScalarStamped", header=interfaces.header(stamp), value=value, std=float("nan")
        )
        yield topic, "cwmav_msgs/msg/ScalarStamped", message


def stamp_ns(message: Any) -> int:
    """Header stamp in nanoseconds."""
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
