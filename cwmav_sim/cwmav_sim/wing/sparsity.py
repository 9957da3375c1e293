# SPDX-License-Identifier: Apache-2.0
"""Where forces and tangents of elements land among the entries of the whole, found once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cwmav_sim.wing.arithmetic import Arithmetic
from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.motion_loops import add_gathered
from cwmav_sim.wing.sheet import FloatArray, IntArray


class Gathering(NamedTuple):
    """Which values belong to each total: ``sources[starts[i] : starts[i + 1]]``, ascending."""

    starts: NDArray[np.int32]
    sources: NDArray[np.int32]


def gathering(target: IntArray, totals: int) -> Gathering:
    """Return which of the values with these targets, any negative ones left out, belong to each total."""
    order = np.argsort(target, kind="stable")
    starts = np.searchsorted(target[order], np.arange(totals + 1))
    return Gathering(starts.astype(np.int32), order.astype(np.int32))


def add_all(
    arithmetic: Arithmetic,
    gatherings: Sequence[Gathering],
    families: Sequence[FloatArray],
    total: FloatArray,
) -> None:
    """Add the values of every family to the totals (n,), family after family."""
    for lists, values in zip(gatherings, families, strict=True):
        arithmetic.run(add_gathered, len(total), *lists, arithmetic.flat(values), total)


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
        self.gatherings = [gathering(t, len(unique)) for t in np.split(target, ends[:-1])]

    @property
    def entries(self) -> int:
        """Number of stored entries."""
        return len(self._indices)

    def matrix(self, stored: NDArray[Any]) -> sp.csc_matrix:
        """Return the matrix with these stored entries."""
        return sp.csc_matrix((stored, self._indices, self._starts), shape=(self.size, self.size))

    @cached_property
    def lu(self) -> BlockLU:
        """Places of the factors of what :meth:`matrix` returns."""
        return BlockLU(self.matrix(np.zeros(self.entries)))
