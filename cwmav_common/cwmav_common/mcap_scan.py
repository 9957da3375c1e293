# SPDX-License-Identifier: Apache-2.0
"""Find the message records in a piece of MCAP data, compiled, because files may hold one message per sample.

Record layout (MCAP specification, "Records"): opcode (1 byte), length (8), content; the content of a
Message is channel id (2), sequence (4), log time (8), publish time (8), data. Everything is little-endian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

SCHEMA, CHANNEL, MESSAGE = 3, 4, 5
RECORD_HEADER = 9
MESSAGE_HEADER = 22


@dataclass(frozen=True)
class MessageIndex:
    """Where the messages of a buffer lie, in file order.

    Attributes
    ----------
    channels, log_times, starts, lengths
        (n,) channel id, log time [ns], first byte and number of bytes of the message data.
    others
        (m,) positions of the schema and channel records.
    end
        Position after the last complete record.
    clean
        False when the data does not end with a complete record.
    """

    channels: NDArray[np.int64]
    log_times: NDArray[np.int64]
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]
    others: NDArray[np.int64]
    end: int
    clean: bool


def scan(buffer: NDArray[np.uint8], *, only_messages: bool = False) -> MessageIndex:
    """Index the records of `buffer`, (size,).

    Parameters
    ----------
    only_messages
        Stop at the first record that is no message, schema or channel (data outside of chunks); otherwise
        unknown records are passed over.
    """
    messages, others, end, clean = _count(buffer, only_messages)
    table = np.empty((4, messages), np.int64)
    other = np.empty(others, np.int64)
    _fill(buffer, end, table, other)
    return MessageIndex(table[0], table[1], table[2], table[3], other, end, clean)


@njit(cache=True, inline="always")
def _integer(buffer: NDArray[np.uint8], position: int, size: int) -> int:
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(buffer[position + k]) << np.int64(8 * k)
    return value  # type: ignore[return-value]  # numba gives an int64


@njit(cache=True)
def _count(buffer: NDArray[np.uint8], only_messages: bool) -> tuple[int, int, int, bool]:
    size = len(buffer)
    position = 0
    messages = 0
    others = 0
    while position < size:
        if position + RECORD_HEADER > size:
            return messages, others, position, False
        opcode = buffer[position]
        known = opcode in (MESSAGE, SCHEMA, CHANNEL)
        if only_messages and not known:
            return messages, others, position, True
        length = _integer(buffer, position + 1, 8)
        if length < 0 or length > size - position - RECORD_HEADER:
            return messages, others, position, False
        if opcode == MESSAGE:
            if length < MESSAGE_HEADER:
                return messages, others, position, False
            messages += 1
        elif known:
            others += 1
        position += RECORD_HEADER + length
    return messages, others, position, True


@njit(cache=True)
def _fill(buffer: NDArray[np.uint8], end: int, table: NDArray[np.int64], other: NDArray[np.int64]) -> None:
    position = 0
    i = 0
    j = 0
    while position < end:
        opcode = buffer[position]
        length = _integer(buffer, position + 1, 8)
        content = position + RECORD_HEADER
        if opcode == MESSAGE:
            table[0, i] = _integer(buffer, content, 2)
            table[1, i] = _integer(buffer, content + 6, 8)
            table[2, i] = content + MESSAGE_HEADER
            table[3, i] = length - MESSAGE_HEADER
            i += 1
        elif opcode in (SCHEMA, CHANNEL):
            other[j] = position
            j += 1
        position = content + length
