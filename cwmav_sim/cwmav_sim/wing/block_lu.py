# SPDX-License-Identifier: Apache-2.0
"""LU factors of a matrix of 3 x 3 blocks whose places never change.

Every unknown of a structure is a vector, so its tangent consists of 3 x 3 blocks, and the elements say once
and for all where they are. Order of elimination and fill are therefore found once; what is left for every
tangent is arithmetic in one loop over block rows. Elimination keeps to the diagonal: the places are
symmetric, the mass term keeps the diagonal dominant enough, and Newton corrects what rounding leaves.
Source: Davis, Direct Methods for Sparse Linear Systems, SIAM 2006, chapters 6 and 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from cwmav_sim.wing.algebra import Vector, compiled, inlined, matrix, minus, put, row, turned
from cwmav_sim.wing.dissection import elimination_order
from cwmav_sim.wing.sheet import FloatArray, IntArray


@dataclass(frozen=True)
class Factors:
    """Factors of one matrix; ``blocks`` (p, 3, 3) lie as :class:`BlockLU` says."""

    lu: BlockLU
    blocks: FloatArray

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for a right-hand side of shape (n, 3)."""
        lu = self.lu
        return _solve(self.blocks, lu.starts, lu.diagonal, lu.columns, lu.order, right)


class BlockLU:
    """Where the factors of all matrices with the same stored entries lie.

    Block rows follow the order of elimination. Each holds the blocks left of the diagonal (of L), the
    diagonal one (its own unit lower and upper triangle) and those right of it (of U), by ascending column.

    Parameters
    ----------
    pattern : scipy.sparse.csc_matrix, shape (3 n, 3 n)
        A matrix with the stored entries of all; their values do not matter.

    Attributes
    ----------
    order : ndarray, shape (n,)
        Vector eliminated in each place.
    starts : ndarray, shape (n + 1,)
        First block of every row.
    diagonal : ndarray, shape (n,)
        Diagonal block of every row.
    columns : ndarray, shape (p,)
        Column of every block.
    places : ndarray, shape (nnz,)
        Place of every stored entry in the flattened blocks.
    """

    def __init__(self, pattern: sp.csc_matrix) -> None:
        size = pattern.shape[0] // 3
        entry_row = pattern.indices.astype(np.int64)
        entry_column = np.repeat(np.arange(3 * size, dtype=np.int64), np.diff(pattern.indptr))
        graph = sp.csc_matrix(
            (np.ones(len(entry_row)), (entry_row // 3, entry_column // 3)), shape=(size, size)
        )
        self.order = elimination_order(graph)
        place = np.empty(size, dtype=np.int64)
        place[self.order] = np.arange(size)
        row, column = _filled(graph, self.order, place)
        key = row * size + column  # ascending
        self.columns = column
        self.starts = np.searchsorted(row, np.arange(size + 1)).astype(np.int64)
        self.diagonal = np.searchsorted(key, np.arange(size) * (size + 1)).astype(np.int64)
        block = np.searchsorted(key, place[entry_row // 3] * size + place[entry_column // 3])
        self.places = 9 * block + 3 * (entry_row % 3) + entry_column % 3

    def factorised(self, stored: FloatArray) -> Factors:
        """Factorise the matrix whose stored entries are given, in the order of the pattern's.

        Raises
        ------
        RuntimeError
            A pivot vanishes, or is not a number.
        """
        blocks = np.zeros((len(self.columns), 3, 3))
        blocks.reshape(-1)[self.places] = stored
        if not _factorise(blocks, self.starts, self.diagonal, self.columns):
            raise RuntimeError("the matrix is singular")
        return Factors(self, blocks)


def _filled(graph: sp.csc_matrix, order: IntArray, place: IntArray) -> tuple[IntArray, IntArray]:
    """Return rows and columns of all blocks of the factors, diagonal included, row after row.

    Eliminating a vector joins all its later neighbours to each other; it is enough to hand them on to the
    first of these.
    """
    later: list[set[int]] = [set() for _ in order]
    for number, at in enumerate(order):
        beside = place[graph.indices[graph.indptr[at] : graph.indptr[at + 1]]]
        later[number].update(beside[beside > number].tolist())
    for near in later:
        if near:
            first = min(near)
            later[first] |= near - {first}
    upper = [(k, j) for k, near in enumerate(later) for j in near]
    pairs = np.array(upper, dtype=np.int64).reshape(-1, 2)
    own = np.arange(len(order), dtype=np.int64)
    row = np.concatenate([pairs[:, 0], own, pairs[:, 1]])
    column = np.concatenate([pairs[:, 1], own, pairs[:, 0]])
    sorting = np.lexsort((column, row))
    return row[sorting], column[sorting]


@compiled
def _factorise(blocks: FloatArray, starts: IntArray, diagonal: IntArray, columns: IntArray) -> bool:
    """Replace a matrix by its factors; False where a pivot vanishes."""
    where = np.zeros(len(diagonal), np.int64)  # block of this row in every column
    for i in range(len(diagonal)):
        for p in range(starts[i], starts[i + 1]):
            where[columns[p]] = p
        for p in range(starts[i], diagonal[i]):
            k = columns[p]
            _divide_by_upper(blocks, p, diagonal[k])
            left = matrix(blocks, p)
            for q in range(diagonal[k] + 1, starts[k + 1]):
                _subtract_product(blocks, where[columns[q]], left, q)
        if not _factorise_block(blocks, diagonal[i]):
            return False
        for p in range(diagonal[i] + 1, starts[i + 1]):
            _divide_by_lower(blocks, p, diagonal[i])
    return True


@inlined
def _subtract_product(blocks: FloatArray, target: int, left: tuple[Vector, Vector, Vector], q: int) -> None:
    for c in range(3):
        first, second, third = blocks[q, 0, c], blocks[q, 1, c], blocks[q, 2, c]
        for r in range(3):
            blocks[target, r, c] -= left[r][0] * first + left[r][1] * second + left[r][2] * third


@inlined
def _factorise_block(blocks: FloatArray, p: int) -> bool:
    """Factorise one diagonal block."""
    b = blocks[p]
    for k in range(3):
        if not abs(b[k, k]) > 0.0:
            return False
        for r in range(k + 1, 3):
            b[r, k] /= b[k, k]
            for c in range(k + 1, 3):
                b[r, c] -= b[r, k] * b[k, c]
    return True


@inlined
def _divide_by_upper(blocks: FloatArray, p: int, d: int) -> None:
    """Multiply block ``p`` from the right by the inverse of the upper triangle of block ``d``."""
    b, u = blocks[p], blocks[d]
    for r in range(3):
        b[r, 0] /= u[0, 0]
        b[r, 1] = (b[r, 1] - b[r, 0] * u[0, 1]) / u[1, 1]
        b[r, 2] = (b[r, 2] - b[r, 0] * u[0, 2] - b[r, 1] * u[1, 2]) / u[2, 2]


@inlined
def _divide_by_lower(blocks: FloatArray, p: int, d: int) -> None:
    """Multiply block ``p`` from the left by the inverse of the unit lower triangle of block ``d``."""
    b, low = blocks[p], blocks[d]
    for c in range(3):
        b[1, c] -= low[1, 0] * b[0, c]
        b[2, c] -= low[2, 0] * b[0, c] + low[2, 1] * b[1, c]


@compiled
def _solve(
    blocks: FloatArray,
    starts: IntArray,
    diagonal: IntArray,
    columns: IntArray,
    order: IntArray,
    right: FloatArray,
) -> FloatArray:
    count = len(diagonal)
    y, out = np.empty((count, 3)), np.empty((count, 3))
    for i in range(count):
        rest = row(right, order[i])
        for p in range(starts[i], diagonal[i]):
            rest = minus(rest, turned(matrix(blocks, p), row(y, columns[p])))
        low = blocks[diagonal[i]]
        second = rest[1] - low[1, 0] * rest[0]
        put(y, i, (rest[0], second, rest[2] - low[2, 0] * rest[0] - low[2, 1] * second))
    for i in range(count - 1, -1, -1):
        rest = row(y, i)
        for p in range(starts[i + 1] - 1, diagonal[i], -1):  # as they become known
            rest = minus(rest, turned(matrix(blocks, p), row(y, columns[p])))
        up = blocks[diagonal[i]]
        third = rest[2] / up[2, 2]
        second = (rest[1] - up[1, 2] * third) / up[1, 1]
        put(y, i, ((rest[0] - up[0, 1] * second - up[0, 2] * third) / up[0, 0], second, third))
        put(out, order[i], row(y, i))
    return out
