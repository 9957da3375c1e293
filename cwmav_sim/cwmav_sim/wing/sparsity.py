# SPDX-License-Identifier: Apache-2.0
"""Where the tangents of elements land among the stored entries of the whole, found once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from cwmav_sim.wing.algebra import compiled
from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.sheet import FloatArray, IntArray


class Pattern:
    """Fixed sparsity of the free part of a matrix that is a sum of small dense blocks.

    Parameters
    ----------
    families : sequence of ndarray, shape (m, d)
        Scalar unknowns ``3 row + axis`` of the blocks of every family.
    rows : int
        Number of vectors.
    free : ndarray, shape (f,)
        Vectors that are kept.
    """

    def __init__(self, families: Sequence[IntArray], rows: int, free: IntArray) -> None:
        row = np.concatenate([np.repeat(d, d.shape[1], axis=1).ravel() for d in families])
        column = np.concatenate([np.tile(d, (1, d.shape[1])).ravel() for d in families])
        number = np.full(3 * rows, -1, dtype=np.int64)
        kept = (3 * free[:, None] + np.arange(3)).ravel()
        number[kept] = np.arange(len(kept))
        row, column = number[row], number[column]
        inside = (row >= 0) & (column >= 0)
        self.size = len(kept)
        key = column[inside] * np.int64(max(self.size, 1)) + row[inside]
        unique, place = np.unique(key, return_inverse=True)
        self._indices = unique % max(self.size, 1)
        counts = np.bincount(unique // max(self.size, 1), minlength=self.size)
        self._starts = np.concatenate([[0], np.cumsum(counts)])
        target = np.full(len(row), -1, dtype=np.int64)
        target[inside] = place
        ends = np.cumsum([d.size * d.shape[1] for d in families])
        self._targets = np.split(target, ends[:-1])

    def assemble(self, values: Sequence[FloatArray]) -> sp.csc_matrix:
        """Sum the blocks (m, d, d) of every family."""
        data = np.zeros(len(self._indices))
        for target, family in zip(self._targets, values, strict=True):
            _gather(data, target, family.reshape(-1))
        return sp.csc_matrix((data, self._indices, self._starts), shape=(self.size, self.size))

    @cached_property
    def lu(self) -> BlockLU:
        """Places of the factors of what :meth:`assemble` returns."""
        empty = np.zeros(len(self._indices))
        return BlockLU(sp.csc_matrix((empty, self._indices, self._starts), shape=(self.size, self.size)))


@compiled
def _gather(data: FloatArray, target: IntArray, values: FloatArray) -> None:
    for i in range(len(target)):
        if target[i] >= 0:
            data[target[i]] += values[i]
