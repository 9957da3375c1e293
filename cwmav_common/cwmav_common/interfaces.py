# SPDX-License-Identifier: Apache-2.0
"""ROS 2 message types without ROS: registered from their .msg text, serialised to CDR by rosbags.

Recordings are written and read by programs that must also work where no ROS is installed. The stock types are
those of Jazzy; the project's own are read from the same .msg files that ``cwmav_msgs`` is built from, so
there is one definition of every field.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cwmav_common.errors import InputError

PACKAGE = "cwmav_msgs"
NANOSECONDS = 1_000_000_000


def message_folder() -> Path:
    """Find the folder of the .msg files of ``cwmav_msgs``.

    Looked for beside the source tree, in the Python environment, then in every prefix of
    ``AMENT_PREFIX_PATH``.

    Raises
    ------
    InputError
        None of the places holds the files; the message lists them.
    """
    candidates = [
        Path(__file__).resolve().parents[2] / "msgs_schema" / "msg",
        Path(sys.prefix) / "share" / "cwmav_common" / PACKAGE / "msg",
    ]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    candidates += [Path(prefix) / "share" / PACKAGE / "msg" for prefix in prefixes if prefix]
    for folder in candidates:
        if any(folder.glob("*.msg")):
            return folder
    places = ", ".join(str(folder) for folder in candidates)
    raise InputError(
        f"the .msg files of {PACKAGE} are in none of: {places}; install cwmav or source its workspace"
    )


@cache
def typestore() -> Typestore:
    """Give the Jazzy types with those of ``cwmav_msgs`` registered."""
    store = get_typestore(Stores.ROS2_JAZZY)
    definitions = {}
    for path in sorted(message_folder().glob("*.msg")):
        definitions.update(get_types_from_msg(path.read_text(encoding="utf-8"), f"{PACKAGE}/msg/{path.stem}"))
    store.register(definitions)
    return store


def known(type_name: str) -> bool:
    """Say whether `type_name` (``package/msg/Name``) can be written and read here."""
    return type_name in typestore().fielddefs


@cache
def schema_text(type_name: str) -> str:
    """Give the ``ros2msg`` schema text of a type with all it depends on, as MCAP files embed it."""
    _require(type_name)
    text, _ = typestore().generate_msgdef(type_name, ros_version=2)
    return text


@cache
def type_hash(type_name: str) -> str:
    """Give the RIHS01 hash of a type (REP 2011), which rosbag2 stores per topic."""
    _require(type_name)
    return typestore().hash_rihs01(type_name)


def message_class(type_name: str) -> type:
    """Give the dataclass that stands for a message type here."""
    _require(type_name)
    return typestore().types[type_name]


def new(type_name: str, /, **values: Any) -> Any:
    """Make a message; fields not given are zero or empty, nested messages may be given as mappings.

    A ``header`` may be given as :func:`header` makes it. Arrays become NumPy arrays of the field's type.

    Raises
    ------
    InputError
        The type or a field name is unknown.
    """
    _require(type_name)
    fields = typestore().fielddefs[type_name][1]
    unknown = set(values) - {name for name, _ in fields}
    if unknown:
        allowed = ", ".join(name for name, _ in fields)
        raise InputError(f"{type_name}: unknown field {sorted(unknown)[0]!r}; allowed: {allowed}")
    arguments = {
        name: _coerce(desc, values[name]) if name in values else _default(desc) for name, desc in fields
    }
    return message_class(type_name)(**arguments)


def header(stamp_ns: int, frame_id: str = "") -> Any:
    """Make a ``std_msgs/Header`` from a time in nanoseconds."""
    sec, nanosec = divmod(int(stamp_ns), NANOSECONDS)
    time = message_class("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)
    return message_class("std_msgs/msg/Header")(stamp=time, frame_id=frame_id)


def serialise(message: Any, type_name: str) -> bytes:
    """Turn a message into little-endian CDR with its encapsulation header."""
    _require(type_name)
    return bytes(typestore().serialize_cdr(message, type_name))


def deserialise(data: bytes | memoryview, type_name: str) -> Any:
    """Turn CDR bytes into a message; array fields are NumPy arrays.

    Raises
    ------
    InputError
        The type is unknown or the bytes are no such message.
    """
    _require(type_name)
    try:
        return typestore().deserialize_cdr(data, type_name)
    except Exception as error:  # the decoder is generated code and raises whatever the bytes lead it to
        raise InputError(f"{len(data)} bytes are no {type_name} ({type(error).__name__}: {error})") from None


def _require(type_name: str) -> None:
    if not known(type_name):
        raise InputError(
            f"unknown message type {type_name!r}; expected package/msg/Name of Jazzy or {PACKAGE}"
        )


def _default(desc: Any) -> Any:
    kind, detail = desc
    if kind == Nodetype.BASE:
        return {"string": "", "wstring": "", "bool": False}.get(detail[0], 0)
    if kind == Nodetype.NAME:
        return new(detail)
    (item_kind, item_detail), count = detail
    length = count if kind == Nodetype.ARRAY else 0
    if item_kind == Nodetype.BASE and item_detail[0] not in ("string", "wstring"):
        return np.zeros(length, dtype=item_detail[0])
    return [_default((item_kind, item_detail)) for _ in range(length)]


def _coerce(desc: Any, value: Any) -> Any:
    kind, detail = desc
    if kind == Nodetype.NAME:
        return new(detail, **value) if isinstance(value, Mapping) else value
    if kind == Nodetype.BASE:
        return value
    (item_kind, item_detail), _ = detail
    if item_kind == Nodetype.BASE and item_detail[0] not in ("string", "wstring"):
        return np.ascontiguousarray(value, dtype=item_detail[0])
    return [_coerce((item_kind, item_detail), item) for item in value]
