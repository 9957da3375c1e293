# SPDX-License-Identifier: Apache-2.0
"""LU factors by 3 x 3 blocks on the card.

The places of the factors are those of the processor, :mod:`cwmav_sim.wing.block_lu`, and so is what is done
to every block: the products of blocks left of it and above it are subtracted by ascending column, then it is
divided by a diagonal block or, on the diagonal, factorised. Which blocks can be worked on at the same time is
found once (:mod:`cwmav_sim.cuda.levels`). What hangs together, such as a panel of a wing, is the work of one
block of threads, which wait for each other between levels, so that one start of a kernel does all of it. The
triangular solves go by rows in the same way.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numba import cuda
from scipy.sparse.csgraph import connected_components

from cwmav_sim.cuda.launch import MANY_THREADS, CardArray, empty, launch, start_blocks, upload
from cwmav_sim.cuda.levels import Work, plan
from cwmav_sim.wing.algebra import compiled
from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.sheet import IntArray


class CardLU:
    """Factors of one matrix after the other, all with the same stored entries.

    Parameters
    ----------
    lu : BlockLU
        Where the factors lie.
    """

    def __init__(self, lu: BlockLU) -> None:
        rows, entries = len(lu.order), 9 * len(lu.columns)
        graph = sp.csr_matrix((np.ones(len(lu.columns)), lu.columns, lu.starts), shape=(rows, rows))
        self._pieces, numbers = connected_components(graph, directed=False)
        piece = numbers.astype(np.int64)
        stored = np.full(entries, -1, dtype=np.int64)
        stored[lu.places] = np.arange(len(lu.places))
        (self._stored,) = _uploaded(stored)
        self._blocks, self._middle = empty(entries), empty((rows, 3))
        self._failed = upload(np.zeros(1, np.int32))
        self._elimination = _uploaded(*_plan_blocks(lu, piece))
        self._down, self._up = (_uploaded(*arrays) for arrays in _plan_rows(lu, piece))

    def factorise(self, data: CardArray) -> None:
        """Factorise a matrix with the stored entries ``data``, shape (nnz,), and wait for the card.

        Raises
        ------
        RuntimeError
            A pivot vanishes, or is not a number.
        """
        launch(_fill, self._blocks.shape[0], data, self._stored, self._blocks, self._failed)
        start_blocks(
            _factorise, self._pieces, self._blocks, *self._elimination, self._failed, threads=MANY_THREADS
        )
        if self._failed.copy_to_host()[0]:
            raise RuntimeError("the matrix is singular")

    def solve(self, right: CardArray, out: CardArray) -> None:
        """Fill ``out`` with the solution for the right-hand side ``right``, two arrays of shape (n, 3)."""
        start_blocks(
            _solve_down, self._pieces, self._blocks, *self._down, right, self._middle, threads=MANY_THREADS
        )
        start_blocks(
            _solve_up, self._pieces, self._blocks, *self._up, self._middle, out, threads=MANY_THREADS
        )


def _uploaded(*arrays: IntArray) -> tuple[CardArray, ...]:
    return tuple(upload(values.astype(np.int32)) for values in arrays)


def _plan_blocks(lu: BlockLU, piece: IntArray) -> tuple[IntArray, ...]:
    """Return what the factorisation takes, from ``own`` to ``divisor``."""
    numbers = np.arange(len(lu.columns))
    row = np.repeat(np.arange(len(lu.order)), np.diff(lu.starts))
    target, left, right = _products(lu.starts, lu.diagonal, lu.columns)
    sorting = np.argsort(target, kind="stable")  # leaves them by ascending column
    target, left, right = target[sorting], left[sorting], right[sorting]
    bounds = np.searchsorted(target, np.arange(len(numbers) + 1))
    divisor = np.where(row == lu.columns, -1, lu.diagonal[np.minimum(row, lu.columns)])
    work = Work(numbers, piece[row], bounds[:-1], bounds[1:], np.stack([left, right]), divisor)
    arrays, divides = plan(work)
    lower = row > lu.columns
    own, other = np.where(lower[target], (left, right), (right, left))
    return own, other, lower, *arrays, divides


def _plan_rows(lu: BlockLU, piece: IntArray) -> list[tuple[IntArray, ...]]:
    """Return what the solves down and up take, from ``columns`` to ``done``.

    A product is that of a block and what its column holds. On the way up the last block comes first.
    """
    down, nothing = np.arange(len(lu.order)), np.full(len(lu.order), -1)
    needs, end = np.stack([lu.columns, lu.columns]), len(lu.columns)
    up, back = down[::-1].copy(), needs[:, ::-1].copy()
    works = (
        Work(down, piece, lu.starts[:-1], lu.diagonal, needs, nothing),
        Work(up, piece, end - lu.starts[1:], end - 1 - lu.diagonal, back, nothing),
    )
    return [(lu.columns, lu.diagonal, lu.order, *plan(work)[0]) for work in works]


@compiled
def _products(starts: IntArray, diagonal: IntArray, columns: IntArray) -> IntArray:
    """Return target, left and right factor of every product of blocks, shape (3, products)."""
    later = starts[1:] - diagonal - 1
    out = np.empty((3, np.sum(later * later)), np.int64)
    where = np.zeros(len(diagonal), np.int64)  # block of this row in every column
    made = 0
    for i in range(len(diagonal)):
        for p in range(starts[i], starts[i + 1]):
            where[columns[p]] = p
        for p in range(starts[i], diagonal[i]):
            for q in range(diagonal[columns[p]] + 1, starts[columns[p] + 1]):
                out[0, made], out[1, made], out[2, made] = where[columns[q]], p, q
                made += 1
    return out


@cuda.jit(cache=True)
def _fill(data, stored, blocks, failed):
    i = cuda.grid(1)
    if i < blocks.shape[0]:
        blocks[i] = data[stored[i]] if stored[i] >= 0 else 0.0
    if i == 0:
        failed[0] = 0


@cuda.jit(cache=True)
def _factorise(
    blocks, own, other, lower, first_level, first_sum, first_done, target, begin, end, done, divisor, failed
):
    """Replace the blocks of a matrix by those of its factors, every piece by a block of threads.

    Three threads share a sum: each has a row of a block of L, or a column of one of U or on the diagonal.
    """
    t, threads, piece = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    for level in range(first_level[piece], first_level[piece + 1]):
        for w in range(3 * first_sum[level] + t, 3 * first_sum[level + 1], threads):
            s, lane = w // 3, w % 3
            left = lower[target[s]] != 0
            across, along = (3, 1) if left else (1, 3)
            at = 9 * target[s] + lane * across
            values = blocks[at], blocks[at + along], blocks[at + 2 * along]
            for q in range(begin[s], end[s]):
                values = _less_product(
                    values, blocks, 9 * own[q] + lane * across, 9 * other[q], across, along
                )
            if divisor[s] >= 0:
                values = _divided(values, blocks, 9 * divisor[s], left)
            blocks[at], blocks[at + along], blocks[at + 2 * along] = values
        cuda.syncthreads()
        for w in range(first_done[level] + t, first_done[level + 1], threads):
            if not _factorise_block(blocks, 9 * done[w]):
                failed[0] = 1
        cuda.syncthreads()


@cuda.jit(device=True)
def _less_product(values, blocks, own, other, across, along):
    """Subtract the product of a row or column at ``own`` and the block at ``other``."""
    x, y, z = values
    a, b, c = blocks[own], blocks[own + along], blocks[own + 2 * along]
    x -= a * blocks[other] + b * blocks[other + across] + c * blocks[other + 2 * across]
    other += along
    y -= a * blocks[other] + b * blocks[other + across] + c * blocks[other + 2 * across]
    other += along
    z -= a * blocks[other] + b * blocks[other + across] + c * blocks[other + 2 * across]
    return x, y, z


@cuda.jit(device=True)
def _divided(values, blocks, d, left):
    """Divide a row by the upper triangle at ``d``, or else a column by the unit lower one."""
    x, y, z = values
    if left:
        x /= blocks[d]
        y = (y - x * blocks[d + 1]) / blocks[d + 4]
        return x, y, (z - x * blocks[d + 2] - y * blocks[d + 5]) / blocks[d + 8]
    y -= blocks[d + 3] * x
    return x, y, z - (blocks[d + 6] * x + blocks[d + 7] * y)


@cuda.jit(device=True)
def _factorise_block(blocks, d):
    """Factorise the diagonal block at ``d``; False where a pivot vanishes."""
    first, u01, u02 = blocks[d], blocks[d + 1], blocks[d + 2]
    l10, l20 = blocks[d + 3] / first, blocks[d + 6] / first
    second, u12 = blocks[d + 4] - l10 * u01, blocks[d + 5] - l10 * u02
    l21 = (blocks[d + 7] - l20 * u01) / second
    third = blocks[d + 8] - l20 * u02 - l21 * u12
    blocks[d + 3], blocks[d + 4], blocks[d + 5] = l10, second, u12
    blocks[d + 6], blocks[d + 7], blocks[d + 8] = l20, l21, third
    return abs(first) > 0.0 and abs(second) > 0.0 and abs(third) > 0.0


@cuda.jit(cache=True)
def _solve_down(
    blocks, columns, diagonal, order, first_level, first_sum, first_done, target, begin, end, done, right, y
):
    """Fill ``y``, by order of elimination, with the solution for the lower factor."""
    t, threads, piece = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    first, last = first_level[piece], first_level[piece + 1]
    for w in range(3 * first_done[first] + t, 3 * first_done[last], threads):
        y[done[w // 3], w % 3] = right[order[done[w // 3]], w % 3]
    cuda.syncthreads()
    for level in range(first, last):
        for w in range(3 * first_sum[level] + t, 3 * first_sum[level + 1], threads):
            _subtract_products(blocks, columns, begin[w // 3], end[w // 3], 1, y, target[w // 3], w % 3)
        cuda.syncthreads()
        for w in range(first_done[level] + t, first_done[level + 1], threads):
            i = done[w]
            d = 9 * diagonal[i]
            second = y[i, 1] - blocks[d + 3] * y[i, 0]
            y[i, 1] = second
            y[i, 2] = y[i, 2] - blocks[d + 6] * y[i, 0] - blocks[d + 7] * second
        cuda.syncthreads()


@cuda.jit(cache=True)
def _solve_up(
    blocks, columns, diagonal, order, first_level, first_sum, first_done, target, begin, end, done, y, out
):
    """Fill ``out`` with the solution for the upper factor; ``y`` holds it too, by order of elimination."""
    last = columns.shape[0] - 1
    t, threads, piece = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    for level in range(first_level[piece], first_level[piece + 1]):
        for w in range(3 * first_sum[level] + t, 3 * first_sum[level + 1], threads):
            _subtract_products(
                blocks, columns, last - begin[w // 3], last - end[w // 3], -1, y, target[w // 3], w % 3
            )
        cuda.syncthreads()
        for w in range(first_done[level] + t, first_done[level + 1], threads):
            i = done[w]
            d = 9 * diagonal[i]
            third = y[i, 2] / blocks[d + 8]
            second = (y[i, 1] - blocks[d + 5] * third) / blocks[d + 4]
            first = (y[i, 0] - blocks[d + 1] * second - blocks[d + 2] * third) / blocks[d]
            y[i, 0], y[i, 1], y[i, 2] = first, second, third
            out[order[i], 0], out[order[i], 1], out[order[i], 2] = first, second, third
        cuda.syncthreads()


@cuda.jit(device=True)
def _subtract_products(blocks, columns, begin, end, step, y, i, lane):
    """Subtract from a component of row ``i`` the blocks from begin to end times what their columns hold."""
    rest = y[i, lane]
    for p in range(begin, end, step):
        a, j = 9 * p + 3 * lane, columns[p]
        rest -= blocks[a] * y[j, 0] + blocks[a + 1] * y[j, 1] + blocks[a + 2] * y[j, 2]
    y[i, lane] = rest
