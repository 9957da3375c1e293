# SPDX-License-Identifier: Apache-2.0
"""Compiled walk over the records of :mod:`cwmav_common.mcap_scan`."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

SCHEMA, CHANNEL, MESSAGE = 3, 4, 5
RECORD_HEADER = 9
MESSAGE_HEADER = 22


@njit(cache=True, inline="always")
def _integer(buffer: NDArray[np.uint8], position: int, size: int) -> int:
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(buffer[position + k]) << np.int64(8 * k)
    return value  # type: ignore[return-value]  # numba gives an int64


@njit(cache=True)
def count(buffer: NDArray[np.uint8], only_messages: bool) -> tuple[int, int, int, bool]:
    """Count messages and other records; give where the last complete one ends and whether all is complete."""
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
def fill(buffer: NDArray[np.uint8], end: int, table: NDArray[np.int64], other: NDArray[np.int64]) -> None:
    """Fill the rows channel, log time, start and length of every message, and the places of other records."""
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
