# SPDX-License-Identifier: Apache-2.0
"""The folder of a rosbag2 recording: which files it names, and its description."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from cwmav_common import interfaces
from cwmav_common.errors import InputError

if TYPE_CHECKING:
    from cwmav_common.mcap_reader import Recording


def folder_files(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the MCAP files of a folder, in order, and notes on what is missing.

    Raises
    ------
    InputError
        It holds no MCAP, its description cannot be read or names another storage.
    """
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
