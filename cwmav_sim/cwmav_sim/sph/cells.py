# SPDX-License-Identifier: Apache-2.0
"""Uniform grid of cells over the box and the counting sort of points into it.

A cell is at least one smoothing length wide, so everything within the support of a particle lies within two
cells of its own. The box is periodic in every direction; in the symmetric half model both y faces are
mirrors instead, which is the same as a periodic full model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

REACH = 2  # cells on either side that hold the support


@dataclass(frozen=True)
class Grid:
    """Box and its cells.

    Attributes
    ----------
    low, size : ndarray, shape (3,)
        Lower corner and extent of the box [m].
    shape : tuple of int
        Cells in x, y, z; y has one cell in two dimensions.
    mirrored : bool
        Whether the y faces are mirrors instead of periodic.
    dimensions : int
        2 or 3.
    """

    low: FloatArray
    size: FloatArray
    shape: tuple[int, int, int]
    mirrored: bool
    dimensions: int

    @property
    def cell(self) -> FloatArray:
        """Extent of a cell [m], shape (3,)."""
        return np.asarray(self.size / np.array(self.shape))

    @property
    def cells(self) -> int:
        """Number of cells."""
        nx, ny, nz = self.shape
        return nx * ny * nz

    @property
    def integers(self) -> IntArray:
        """Shape, mirror flag and y reach, as the kernels take them, shape (5,)."""
        reach_y = REACH if self.dimensions == 3 else 0
        return np.array([*self.shape, int(self.mirrored), reach_y], dtype=np.int64)

    def wrap(self, x: FloatArray) -> None:
        """Bring positions ``x``, shape (n, 3), back into the box, in place."""
        _wrap(x, self.low, self.size, self.mirrored)

    def reflect(self, x: FloatArray, v: FloatArray) -> None:
        """Bring positions and velocities, shape (n, 3), back from behind the mirrors, in place."""
        _reflect(x, v, float(self.low[1]), float(self.low[1] + self.size[1]))


def make_grid(low: FloatArray, size: FloatArray, h: float, *, mirrored: bool, dimensions: int) -> Grid:
    """Divide a box into cells no smaller than ``h`` [m].

    Raises
    ------
    InputError
        If the box is too small for the support of one particle to lie in it once.
    """
    counts = np.floor(size / h * (1.0 + 1e-12)).astype(int)
    if dimensions == 2:
        counts[1] = 1
    for axis in (0, 1, 2):
        least = 1 if axis == 1 and dimensions == 2 else (REACH if axis == 1 and mirrored else 2 * REACH + 2)
        if counts[axis] < least:
            raise InputError(
                f"box: extent in {'xyz'[axis]} is {size[axis]:g} m; allowed: at least {least * h:g} m "
                f"({least} smoothing lengths)"
            )
    return Grid(low, size, (int(counts[0]), int(counts[1]), int(counts[2])), mirrored, dimensions)


@dataclass(frozen=True)
class Sorting:
    """Points in cell order.

    Attributes
    ----------
    order : ndarray, shape (n,), int64
        Index of the point at each place.
    start : ndarray, shape (cells + 1,), int64
        First place of every cell; cells run x fastest, then y, then z.
    column : ndarray, shape (n,), int64
        x index of the cell of the point at each place.
    local : ndarray, shape (n, 3), float64
        Position relative to the centre of its own cell [m], at each place.
    """

    order: IntArray
    start: IntArray
    column: IntArray
    local: FloatArray


def sort_into_cells(x: FloatArray, grid: Grid) -> Sorting:
    """Sort positions ``x`` [m], shape (n, 3), inside the box, stably by cell."""
    return Sorting(*_sort(x, grid.low, grid.cell, grid.integers, grid.cells))


@nb.njit(cache=True, parallel=True)
def _reflect(x: FloatArray, v: FloatArray, low: float, high: float) -> None:
    for i in nb.prange(x.shape[0]):
        if x[i, 1] < low or x[i, 1] > high:
            face = low if x[i, 1] < low else high
            x[i, 1] = 2.0 * face - x[i, 1]
            v[i, 1] = -v[i, 1]


@nb.njit(cache=True)
def wrapped(x: float, low: float, size: float) -> float:
    """Return a coordinate brought back between the periodic faces ``low`` and ``low + size``."""
    offset = x - low
    if offset >= 0.0 and offset < size:
        return x
    offset -= size * np.floor(offset / size)
    return low if offset >= size else low + offset


@nb.njit(cache=True)
def cell_index(x: float, low: float, cell: float, cells: int) -> int:
    """Return the index of the cell of a coordinate; what lies outside belongs to the outermost cells."""
    return min(max(int(np.floor((x - low) / cell)), 0), cells - 1)


@nb.njit(cache=True)
def from_centre(x: float, low: float, cell: float, index: int) -> float:
    """Return where a coordinate lies from the centre of the cell of an index."""
    return x - low - (index + 0.5) * cell


@nb.njit(cache=True, parallel=True)
def _wrap(x: FloatArray, low: FloatArray, size: FloatArray, mirrored: bool) -> None:
    for i in nb.prange(x.shape[0]):
        for k in range(3):
            if k != 1 or not mirrored:
                x[i, k] = wrapped(x[i, k], low[k], size[k])


@nb.njit(cache=True, parallel=True)
def _sort(
    x: FloatArray, low: FloatArray, cell: FloatArray, integers: IntArray, cells: int
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    n = x.shape[0]
    nx, ny = integers[0], integers[1]
    index = np.empty((n, 3), np.int32)
    number = np.empty(n, np.int64)
    for i in nb.prange(n):
        for k in range(3):
            index[i, k] = cell_index(x[i, k], low[k], cell[k], integers[k])
        number[i] = (index[i, 2] * ny + index[i, 1]) * nx + index[i, 0]
    start = np.zeros(cells + 1, np.int64)
    for i in range(n):
        start[number[i] + 1] += 1
    for c in range(cells):
        start[c + 1] += start[c]
    place = start[:-1].copy()
    order = np.empty(n, np.int64)
    for i in range(n):
        order[place[number[i]]] = i
        place[number[i]] += 1
    column = np.empty(n, np.int64)
    local = np.empty((n, 3), np.float64)
    for j in nb.prange(n):
        i = order[j]
        column[j] = index[i, 0]
        for k in range(3):
            local[j, k] = from_centre(x[i, k], low[k], cell[k], index[i, k])
    return order, start, column, local
