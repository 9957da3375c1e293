# SPDX-License-Identifier: Apache-2.0
"""Running totals on the card, and maxima and sums in a fixed order.

Nothing here uses an atomic operation on floating-point numbers: every sum is taken over fixed pieces in a
fixed order, so results repeat bit for bit.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numba import cuda

from cwmav_sim.cuda.launch import THREADS, CardArray, empty, launch, start_blocks

_CHUNK = 64  # entries that one thread adds up


class Scan:
    """Exclusive running total of ``count`` integers.

    Parameters
    ----------
    count : int
        Number of integers.
    """

    def __init__(self, count: int) -> None:
        self._totals = empty(-(-count // _CHUNK), np.int32)

    def __call__(self, values: CardArray, out: CardArray) -> None:
        """Fill ``out``, shape (count + 1,), with the sum of the values before each, and of all of them."""
        chunks = self._totals.shape[0]
        launch(_chunk_totals, chunks, values, self._totals)
        launch(_scan_totals, 1, self._totals)
        launch(_spread, chunks, values, self._totals, out)


@cuda.jit(cache=True)
def _chunk_totals(values, totals):
    t = cuda.grid(1)
    if t < totals.shape[0]:
        total = 0
        for i in range(t * _CHUNK, min((t + 1) * _CHUNK, values.shape[0])):
            total += values[i]
        totals[t] = total


@cuda.jit(cache=True)
def _scan_totals(totals):
    """Run by one block: every thread takes a stretch of the totals, the first thread those of the others."""
    part = cuda.shared.array(THREADS, nb.int64)
    t = cuda.threadIdx.x
    n = totals.shape[0]
    each = (n + THREADS - 1) // THREADS
    first = min(t * each, n)
    last = min(first + each, n)
    running = 0
    for i in range(first, last):
        running += totals[i]
    part[t] = running
    cuda.syncthreads()
    if t == 0:
        running = 0
        for q in range(THREADS):
            value = part[q]
            part[q] = running
            running += value
    cuda.syncthreads()
    running = part[t]
    for i in range(first, last):
        value = totals[i]
        totals[i] = running
        running += value


@cuda.jit(cache=True)
def _spread(values, totals, out):
    t = cuda.grid(1)
    if t < totals.shape[0]:
        running = totals[t]
        for i in range(t * _CHUNK, min((t + 1) * _CHUNK, values.shape[0])):
            out[i] = running
            running += values[i]
        if t == totals.shape[0] - 1:
            out[values.shape[0]] = running


def reduce_blocks(partial: CardArray, largest: int, out: CardArray, at: int) -> None:
    """Bring what every block found, shape (rows, blocks), into ``out[at : at + rows]``.

    The first ``largest`` rows are maxima of numbers not below zero, the others sums.
    """
    start_blocks(_reduce_blocks, partial.shape[0], partial, largest, out, at)


@cuda.jit(cache=True)
def _reduce_blocks(partial, largest, out, at):
    part = cuda.shared.array(THREADS, nb.float64)
    row = cuda.blockIdx.x
    t = cuda.threadIdx.x
    found = 0.0
    for b in range(t, partial.shape[1], THREADS):
        value = partial[row, b]
        found = max(found, value) if row < largest else found + value
    part[t] = found
    cuda.syncthreads()
    if t == 0:
        found = 0.0
        for q in range(THREADS):
            found = max(found, part[q]) if row < largest else found + part[q]
        out[at + row] = found
