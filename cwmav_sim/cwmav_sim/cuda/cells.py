# SPDX-License-Identifier: Apache-2.0
"""The cells of the box on the card, and the sorting of points into them.

A counting sort: integer counts per cell, their running total, then every point to its place. Points of one
cell arrive in any order and are put into the order of their numbers afterwards, so the result is that of the
stable sort on the processor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from cwmav_sim.cuda.launch import CardArray, clear, empty, launch, zeros
from cwmav_sim.cuda.scan import Scan
from cwmav_sim.sph.cells import Grid

# Places in the integers of a grid.
NX, NY, NZ, MIRRORED, REACH_Y = range(5)

# Places in the reach, the constants of the search in the precision of the pairs.
CELL_X, CELL_Y, CELL_Z, SUPPORT2, PER_CELL_X, COLUMNS, HALF, ONE, MINUS_TWO, ZERO = range(10)


@dataclass(frozen=True)
class CardGrid:
    """Box and cells as the kernels take them.

    Attributes
    ----------
    integers : tuple of int
        Cells in x, y, z, whether y is mirrored, reach in y.
    low, size, cell : tuple of float
        Lower corner, extent of the box and of a cell [m].
    reach : tuple of float
        In the precision of the pairs: extent of a cell (3) [m], square of the support [m2], cells per metre
        and number of cells along x, then 1/2, 1, -2 and 0.
    cells : int
        Number of cells.
    """

    integers: tuple[Any, ...]
    low: tuple[float, ...]
    size: tuple[float, ...]
    cell: tuple[float, ...]
    reach: tuple[Any, ...]
    cells: int

    @classmethod
    def of(cls, grid: Grid, h: float, dtype: np.dtype) -> CardGrid:
        """Return a grid for the support of a smoothing length ``h`` [m] in the precision of the pairs."""
        cell = grid.cell
        reach = [*cell, 4.0 * h * h, 1.0 / cell[0], grid.shape[0], 0.5, 1.0, -2.0, 0.0]
        return cls(
            integers=tuple(np.int32(value) for value in grid.integers),
            low=floats(grid.low),
            size=floats(grid.size),
            cell=floats(cell),
            reach=tuple(np.array(reach, dtype)),
            cells=grid.cells,
        )


def floats(values: NDArray) -> tuple[float, ...]:
    """Return an array as a tuple of plain numbers."""
    return tuple(float(value) for value in values)


class CellSort:
    """Order of ``count`` points by the number of their cell.

    Attributes
    ----------
    key : array, shape (count,), int32
        Number of the cell of every point; to be filled before sorting.
    start : array, shape (cells + 1,), int32
        First place of every cell.
    order : array, shape (count,), int32
        Number of the point at every place.
    """

    def __init__(self, count: int, cells: int) -> None:
        self.key = empty(count, np.int32)
        self.start = empty(cells + 1, np.int32)
        self.order = empty(count, np.int32)
        self._rank, self._arrived = empty(count, np.int32), empty(count, np.int32)
        self._tally = zeros(cells, np.int32)
        self._scan = Scan(cells)

    def sort(self) -> None:
        """Fill ``start`` and ``order`` from ``key``."""
        count = self.key.shape[0]
        clear(self._tally)
        launch(_tally, count, self.key, self._tally, self._rank)
        self._scan(self._tally, self.start)
        launch(_place, count, self.key, self._rank, self.start, self._arrived)
        launch(_settle, count, self.key, self.start, self._arrived, self.order)


def find_cells(x: CardArray, grid: CardGrid, key: CardArray) -> None:
    """Fill in the cell of every position ``x`` [m], shape (3, n), inside the box."""
    launch(_find_cells, key.shape[0], x, grid.low, grid.cell, grid.integers, key)


@cuda.jit(device=True)
def cell_number(x, y, z, low, cell, integers):
    """Return the number of the cell around a position [m]."""
    cx = _index(x, low[0], cell[0], integers[NX])
    cy = _index(y, low[1], cell[1], integers[NY])
    cz = _index(z, low[2], cell[2], integers[NZ])
    return (cz * integers[NY] + cy) * integers[NX] + cx


@cuda.jit(device=True)
def _index(x, low, cell, count):
    offset = (x - low) / cell
    if not offset > 0.0:  # an undefined position too has to go somewhere
        return 0
    if offset >= count:
        return count - 1
    return int(offset)


@cuda.jit(device=True)
def place_of(number, integers):
    """Return the indices of a cell in x, y and z."""
    cx = number % integers[NX]
    rest = number // integers[NX]
    return np.int32(cx), np.int32(rest % integers[NY]), np.int32(rest // integers[NY])


@cuda.jit(cache=True)
def _find_cells(x, low, cell, integers, key):
    i = cuda.grid(1)
    if i < key.shape[0]:
        key[i] = cell_number(x[0, i], x[1, i], x[2, i], low, cell, integers)


@cuda.jit(cache=True)
def _tally(key, tally, rank):
    i = cuda.grid(1)
    if i < key.shape[0]:
        rank[i] = cuda.atomic.add(tally, key[i], 1)


@cuda.jit(cache=True)
def _place(key, rank, start, order):
    i = cuda.grid(1)
    if i < key.shape[0]:
        order[start[key[i]] + rank[i]] = i


@cuda.jit(cache=True)
def _settle(key, start, arrived, order):
    """Put the points of every cell into the order of their numbers: each counts those before it."""
    j = cuda.grid(1)
    if j < order.shape[0]:
        i = arrived[j]
        first, last = start[key[i]], start[key[i] + 1]
        at = first
        for q in range(first, last):
            if arrived[q] < i:
                at += 1
        order[at] = i
