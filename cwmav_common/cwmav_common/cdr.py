# SPDX-License-Identifier: Apache-2.0
"""Chosen fields of many CDR messages at once, as NumPy columns.

A recording of a 10 kHz force sensor holds one message per sample. Decoding them one by one costs 10-20
microseconds each; but equal messages lie equally in memory. The layout of one message is worked out from its
schema, then every message with the same length and the same array and string lengths is read by one strided
view. Messages that differ form further groups, so nothing is assumed about a recording made by others.

The format is OMG DDS-XTypes 1.3, section 7.4.1 (plain CDR, version 1): primitive members aligned to their
size relative to the end of the 4-byte encapsulation header.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from cwmav_common.errors import InputError
from cwmav_common.interfaces import typestore

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]

_ENCAPSULATION = 4
_SIZES = {
    "bool": 1, "byte": 1, "char": 1, "octet": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2,
    "int32": 4, "uint32": 4, "int64": 8, "uint64": 8, "float32": 4, "float64": 8,
}  # fmt: skip
_ONE_BYTE = {"bool": "u1", "byte": "u1", "char": "u1", "octet": "u1", "int8": "i1", "uint8": "u1"}


class LayoutError(InputError):
    """The bytes are no message of the expected type, or a wanted field does not exist."""


@dataclass(frozen=True)
class Slot:
    """Where one wanted field lies: byte offset in the payload, type, number of elements (1 for a scalar)."""

    offset: int
    dtype: np.dtype[Any]
    count: int
    scalar: bool


@dataclass(frozen=True)
class Group:
    """Messages of one layout: rows in the batch and one array per wanted field, (n,) or (n, count)."""

    rows: Indices
    columns: dict[str, NDArray[Any]]


class Columns:
    """Reader of the fields `paths` (``header.stamp.sec``, ``wrench.force.z``) of one message type.

    Parameters
    ----------
    type_name
        ``package/msg/Name``.
    paths
        Wanted numeric fields, dotted; strings are given as arrays of bytes.
    schema
        The ``ros2msg`` text embedded in the recording. It is what the writer used, so it wins over the types
        known here; without it those are taken.
    """

    def __init__(self, type_name: str, paths: Sequence[str], schema: str | None = None) -> None:
        self.type_name = type_name
        self.paths = tuple(paths)
        self._fields = _field_definitions(type_name, schema)
        missing = [path for path in paths if not _has(self._fields, type_name, path)]
        if missing:
            raise LayoutError(f"{type_name} has no field {missing[0]!r}")

    def groups(self, buffer: Bytes, starts: Indices, lengths: Indices) -> Iterator[Group]:
        """Decode the messages at `starts` with `lengths` in `buffer`; undecodable ones are left out."""
        left = np.arange(len(starts))
        while len(left):
            first = left[0]
            payload = buffer[starts[first] : starts[first] + lengths[first]]
            try:
                walk = _Walk(self._fields, payload, self.paths).run(self.type_name)
            except LayoutError:
                left = left[1:]
                continue
            same = lengths[left] == lengths[first]
            for offset, word in walk.guards:
                where = starts[left[same]][:, None] + offset + np.arange(len(word))
                same[same] = (buffer[where] == word).all(axis=1)
            rows = left[same]
            yield Group(
                rows, {path: _gather(buffer, starts[rows], slot) for path, slot in walk.slots.items()}
            )
            left = left[~same]


def _field_definitions(type_name: str, schema: str | None) -> dict[str, Any]:
    definitions = dict(typestore().fielddefs)
    if schema:
        try:
            definitions.update(get_types_from_msg(schema, type_name))
        except Exception as error:  # the parser raises its own family and more on malformed text
            raise LayoutError(f"schema of {type_name} cannot be read ({error})") from None
    if type_name not in definitions:
        raise LayoutError(f"unknown message type {type_name!r} and no schema in the recording")
    return definitions


def _has(definitions: dict[str, Any], type_name: str, path: str) -> bool:
    head, _, rest = path.partition(".")
    for name, (kind, detail) in definitions[type_name][1]:
        if name == head:
            if kind == Nodetype.NAME:
                return bool(rest) and _has(definitions, detail, rest)
            return not rest
    return False


class _Walk:
    """One pass over one payload, noting wanted fields and every length that the layout depends on."""

    def __init__(self, definitions: dict[str, Any], payload: Bytes, wanted: Sequence[str]) -> None:
        self.definitions = definitions
        self.payload = payload
        self.wanted = set(wanted)
        self.slots: dict[str, Slot] = {}
        self.guards: list[tuple[int, Bytes]] = []
        self.position = _ENCAPSULATION
        self.order = "<"

    def run(self, type_name: str) -> _Walk:
        if len(self.payload) < _ENCAPSULATION or self.payload[0] != 0 or self.payload[1] > 1:
            raise LayoutError("unknown CDR encapsulation")
        self.order = "<" if self.payload[1] == 1 else ">"
        self.guards.append((0, self.payload[:2].copy()))
        self._struct(type_name, "")
        if len(self.slots) != len(self.wanted):
            raise LayoutError("a wanted field lies in an array of messages")
        return self

    def _struct(self, type_name: str, prefix: str) -> None:
        for name, (kind, detail) in self.definitions[type_name][1]:
            path = prefix + name
            if kind == Nodetype.NAME:
                self._struct(detail, path + ".")
            elif kind == Nodetype.BASE:
                self._item(detail[0], path)
            else:
                (item_kind, item_detail), count = detail
                if kind == Nodetype.SEQUENCE:
                    count = self._length()
                self._array(item_kind, item_detail, count, path)

    def _item(self, base: str, path: str) -> None:
        if base == "string":
            self._note(path, "u1", self._length(), scalar=False, size=1)
        elif base in _SIZES:
            self._note(path, base, 1, scalar=True, size=_SIZES[base])
        else:
            raise LayoutError(f"fields of type {base} are not supported")

    def _array(self, kind: Any, detail: Any, count: int, path: str) -> None:
        if kind == Nodetype.BASE and detail[0] in _SIZES:
            self._note(path, detail[0], count, scalar=False, size=_SIZES[detail[0]])
            return
        for _ in range(count):
            if kind == Nodetype.BASE:
                self._item(detail[0], "")
            else:
                self._struct(detail, "\0")  # no wanted path starts like this

    def _length(self) -> int:
        self._align(4)
        word = self._take(4)
        self.guards.append((self.position - 4, word.copy()))
        return int(word.view(np.dtype(self.order + "u4"))[0])

    def _note(self, path: str, base: str, count: int, *, scalar: bool, size: int) -> None:
        if count:
            self._align(size)
        if path in self.wanted:
            dtype = np.dtype(_ONE_BYTE.get(base, base)).newbyteorder(self.order)  # type: ignore[arg-type]
            self.slots[path] = Slot(self.position, dtype, count, scalar)
        self._take(size * count)

    def _align(self, size: int) -> None:
        self.position += -(self.position - _ENCAPSULATION) % size

    def _take(self, size: int) -> Bytes:
        end = self.position + size
        if end > len(self.payload):
            raise LayoutError(f"message ends after {len(self.payload)} bytes, {end} expected")
        part = self.payload[self.position : end]
        self.position = end
        return np.ascontiguousarray(part)


def _gather(buffer: Bytes, starts: Indices, slot: Slot) -> NDArray[Any]:
    size = slot.dtype.itemsize * slot.count
    first = starts + slot.offset
    n = len(first)
    if size == 0:
        return np.empty((n, 0), dtype=slot.dtype.newbyteorder("="))
    stride = int(first[1] - first[0]) if n > 1 else size
    if n == 1 or (stride > 0 and bool((np.diff(first) == stride).all())):
        raw = np.lib.stride_tricks.as_strided(
            buffer[int(first[0]) :], (n, size), (stride, 1), writeable=False
        )
        raw = np.ascontiguousarray(raw)
    else:
        raw = buffer[first[:, None] + np.arange(size)]
    values = raw.view(slot.dtype).astype(slot.dtype.newbyteorder("="), copy=False)
    return values[:, 0] if slot.scalar else values
