# SPDX-License-Identifier: Apache-2.0
"""Find the message records in a piece of MCAP data, compiled, because files may hold one message per sample.

Record layout (MCAP specification, "Records"): opcode (1 byte), length (8), content; the content of a
Message is channel id (2), sequence (4), log time (8), publish time (8), data. Everything is little-endian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RECORD_HEADER = 9


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
    # Imported late: a look at the index of a file needs no compiled code.
    from cwmav_common.mcap_kernel import count, fill

    messages, others, end, clean = count(buffer, only_messages)
    table = np.empty((4, messages), np.int64)
    other = np.empty(others, np.int64)
    fill(buffer, end, table, other)
    return MessageIndex(table[0], table[1], table[2], table[3], other, end, clean)
