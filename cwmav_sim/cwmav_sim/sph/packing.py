# SPDX-License-Identifier: Apache-2.0
"""Points on the walls in panel and cell order: one loop, because a step packs some thousand four times."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.cells import Grid, cell_index, from_centre, wrapped

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class PackedPoints:
    """Points on all walls in panel and cell order, in the precision of the pairs.

    Attributes
    ----------
    rows : ndarray, shape (k, m)
        Position relative to the centre of the own cell, then further values.
    column : ndarray, shape (m,)
        x index of the cell of each point.
    start : ndarray, shape (panels, cells + 1)
        First place of every cell, panel by panel.
    number : ndarray, shape (m,)
        Number of the point at every place.
    """

    rows: NDArray
    column: NDArray
    start: IntArray
    number: IntArray


def pack_points(
    x: FloatArray,
    panel: IntArray,
    chosen: IntArray,
    vectors: tuple[FloatArray, ...],
    scalars: tuple[FloatArray, ...],
    panels: int,
    grid: Grid,
    dtype: np.dtype,
) -> PackedPoints:
    """Sort points by panel and, stably, by cell.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions [m], inside the box or beyond its periodic faces.
    panel : ndarray, shape (n,), int
        Panel of every point.
    chosen : ndarray, shape (m,), int
        Which of the points are packed; their numbers count within this choice.
    vectors, scalars : tuple of ndarray, shape (n, 3) and (n,)
        Further values of every point.
    panels : int
        Number of panels.
    grid : Grid
        Cells.
    dtype : numpy.dtype
        Precision of the pairs.
    """
    count = len(chosen)
    rows = np.empty((3 + 3 * len(vectors) + len(scalars), count), dtype)
    column, number = np.empty(count, dtype), np.empty(count, np.int64)
    first = np.zeros(panels * grid.cells + 1, np.int64)
    _pack(
        x,
        panel,
        chosen,
        vectors,
        scalars,
        grid.low,
        grid.size,
        grid.cell,
        grid.integers,
        rows,
        column,
        number,
        first,
    )
    return PackedPoints(rows, column, _by_panel(first, panels), number)


def _by_panel(first: IntArray, panels: int) -> IntArray:
    cells = (len(first) - 1) // panels
    return np.array([first[p * cells : (p + 1) * cells + 1] for p in range(panels)])


@nb.njit(cache=True, error_model="numpy")
def _pack(
    x: FloatArray,
    panel: IntArray,
    chosen: IntArray,
    vectors: tuple[FloatArray, ...],
    scalars: tuple[FloatArray, ...],
    low: FloatArray,
    size: FloatArray,
    cell: FloatArray,
    integers: IntArray,
    rows: NDArray,
    column: NDArray,
    number: IntArray,
    first: IntArray,
) -> None:
    count = chosen.shape[0]
    nx, ny, nz, mirrored = integers[0], integers[1], integers[2], integers[3]
    index, local = np.empty((count, 3), np.int64), np.empty((count, 3))
    key = np.empty(count, np.int64)
    for j in range(count):
        for q in range(3):
            at = x[chosen[j], q]
            if q != 1 or not mirrored:
                at = wrapped(at, low[q], size[q])
            index[j, q] = cell_index(at, low[q], cell[q], integers[q])
            local[j, q] = from_centre(at, low[q], cell[q], index[j, q])
        inside = (index[j, 2] * ny + index[j, 1]) * nx + index[j, 0]
        key[j] = panel[chosen[j]] * (nx * ny * nz) + inside
        first[key[j] + 1] += 1
    for c in range(first.shape[0] - 1):
        first[c + 1] += first[c]
    place = first[:-1].copy()
    for j in range(count):
        at, i = place[key[j]], chosen[j]
        place[key[j]] += 1
        number[at], column[at] = j, index[j, 0]
        for q in range(3):
            rows[q, at] = local[j, q]
        row = 3
        for vector in vectors:
            for q in range(3):
                rows[row + q, at] = vector[i, q]
            row += 3
        for scalar in scalars:
            rows[row, at] = scalar[i]
            row += 1
