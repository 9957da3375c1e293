# SPDX-License-Identifier: Apache-2.0
"""Copy everything around a patch of cells into one contiguous buffer.

Points are stored in cell order, x fastest, with coordinates relative to the centre of their own cell, so
single precision suffices however large the box is. A buffer belongs to a patch (see ``patches``) and is
filled slab by slab along z and row by row along y: a row holds the points of the cells within reach in x, in
a run of memory or two. What surrounds one cell of the patch is then a few contiguous pieces, one per slab
within its reach, and every row is copied once although it serves many cells. Coordinates in the buffer are
relative to the centre of the patch; periodic images and mirror images are ordinary entries.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba as nb
import numpy as np

from cwmav_sim.sph.blocks import BLOCK, add_block, scaled_block, set_block
from cwmav_sim.sph.cells import REACH
from cwmav_sim.sph.patches import ROWS, SLABS, centre_of, fullest, slabs_and_rows

PADDING = BLOCK  # entries behind the last, which may be looked at together with it
FAR = 1.0e3  # metres; padding entries lie here, outside every support
_LINE = 64  # bytes of a cache line
# A processor takes addresses for the same whose last twelve binary digits are, and waits for nothing. Rows
# of a buffer lie a whole number of pages and a small step apart, so that none is taken for another.
_PAGE, _STEP = 1024, 48  # entries in single precision; blocks both
MOST_RUNS = 2 * ROWS  # of a slab: a row is cut once at most, by a periodic face
ANY_IMAGE = 0  # points as they are and mirror images alike

# Columns of a run: first and last place, shift in x, y and z [cells], sign of y.
FIRST, LAST, SHIFT_X, SHIFT_Y, SHIFT_Z, SIGN = range(6)


class Runs(NamedTuple):
    """Runs of memory around a patch, slab by slab.

    Attributes
    ----------
    rows : ndarray, shape (SLABS, MOST_RUNS, 6), int
        First and last place, shift and sign of every run.
    count : ndarray, shape (SLABS,), int
        Number of runs of every slab.
    """

    rows: Any
    count: Any


@nb.njit(cache=True, error_model="numpy")
def row_runs(start, integers, x, y, z, centre, image, runs, count):
    """List the contiguous runs of points of a row: cells within reach of ``x`` along x, at ``y`` and ``z``.

    Indices may lie beyond the faces of the box, less than one period away, because a grid has more cells
    along a periodic axis than a surrounding (:func:`cwmav_sim.sph.cells.make_grid`).

    Parameters
    ----------
    start, integers : ndarray
        First place of every cell and grid integers.
    x, y, z : int
        Cell in the middle of the row.
    centre : tuple of 2 int
        Indices along y and z that shifts refer to; along x they refer to ``x``.
    image : int
        1 takes the points themselves, -1 their mirror images and :data:`ANY_IMAGE` both.
    runs : ndarray, shape (most, 6), int
        Filled from ``count`` on.
    count : int
        Runs that are listed already.

    Returns
    -------
    int
        Runs that are listed then.
    """
    nx, ny, nz, mirrored = integers[0], integers[1], integers[2], integers[3]
    kz = z + (nz if z < 0 else (-nz if z >= nz else 0))  # no division: it takes longer than a copy
    ky, sign = y, 1
    if mirrored:
        if ky < 0:
            ky, sign = -1 - ky, -1
        elif ky >= ny:
            ky, sign = 2 * ny - 1 - ky, -1
    else:
        ky += ny if ky < 0 else (-ny if ky >= ny else 0)
    if sign == -image:
        return count
    row = (kz * ny + ky) * nx
    at = x - REACH
    while at <= x + REACH:
        lap = -1 if at < 0 else (1 if at >= nx else 0)
        end = min(x + REACH, (lap + 1) * nx - 1)
        first, last = start[row + at - lap * nx], start[row + end - lap * nx + 1]
        if last > first:
            runs[count, FIRST] = first
            runs[count, LAST] = last
            runs[count, SHIFT_X] = lap * nx - x
            runs[count, SHIFT_Y] = y - centre[0]
            runs[count, SHIFT_Z] = z - centre[1]
            runs[count, SIGN] = sign
            count += 1
        at = end + 1
    return count


@nb.njit(cache=True, error_model="numpy")
def gather_rows(packed, column, runs, begin, end, cell, vectors, scalars, buf, m):
    """Copy the points of the runs into ``buf`` from entry ``m`` on and return the entry after the last.

    Parameters
    ----------
    packed : ndarray, shape (3 * vectors + scalars, n)
        Position, then further vectors, then scalars, in cell order.
    column : ndarray, shape (n,)
        x index of the cell of each point, in the precision of the pairs.
    runs : ndarray, shape (most, 6), int
        From :func:`row_runs`.
    begin, end : int
        First run and the one after the last.
    cell : ndarray, shape (3,)
        Extent of a cell [m], in the precision of the pairs.
    vectors, scalars : int
        How the rows of ``packed`` divide; the y component of every vector changes sign in a mirror.
    buf : ndarray, shape (rows, room)
        Filled.
    m : int
        First free entry.
    """
    one, zero = cell.dtype.type(1.0), cell.dtype.type(0.0)
    for run in range(begin, end):
        first, last = runs[run, FIRST], runs[run, LAST]
        length = last - first
        sign = cell.dtype.type(runs[run, SIGN])
        shift_x = cell.dtype.type(runs[run, SHIFT_X])
        shift_y = cell.dtype.type(runs[run, SHIFT_Y]) * cell[1]
        shift_z = cell.dtype.type(runs[run, SHIFT_Z]) * cell[2]
        # Whole blocks may read beyond the run; what they leave in the buffer is overwritten or padding.
        blocks = min((length + BLOCK - 1) // BLOCK, (packed.shape[1] - first) // BLOCK)
        for block in range(blocks):
            source, target = first + block * BLOCK, m + block * BLOCK
            scaled_block(buf, 0, target, packed, 0, source, one, shift_x * cell[0])
            add_block(buf, 0, target, column, source, cell[0])
            scaled_block(buf, 1, target, packed, 1, source, sign, shift_y)
            scaled_block(buf, 2, target, packed, 2, source, one, shift_z)
            for k in range(1, vectors):
                scaled_block(buf, 3 * k, target, packed, 3 * k, source, one, zero)
                scaled_block(buf, 3 * k + 1, target, packed, 3 * k + 1, source, sign, zero)
                scaled_block(buf, 3 * k + 2, target, packed, 3 * k + 2, source, one, zero)
            for k in range(3 * vectors, 3 * vectors + scalars):
                scaled_block(buf, k, target, packed, k, source, one, zero)
        for j in range(blocks * BLOCK, length):
            buf[0, m + j] = packed[0, first + j] + shift_x * cell[0] + column[first + j] * cell[0]
            buf[1, m + j] = sign * packed[1, first + j] + shift_y
            buf[2, m + j] = packed[2, first + j] + shift_z
            for k in range(1, vectors):
                buf[3 * k, m + j] = packed[3 * k, first + j]
                buf[3 * k + 1, m + j] = sign * packed[3 * k + 1, first + j]
                buf[3 * k + 2, m + j] = packed[3 * k + 2, first + j]
            for k in range(3 * vectors, 3 * vectors + scalars):
                buf[k, m + j] = packed[k, first + j]
        m += length
    return m


@nb.njit(cache=True, error_model="numpy")
def _pad(buf, used):
    """Put entries far away behind the ``used`` ones."""
    for k in range(buf.shape[0]):
        set_block(buf, k, used, buf.dtype.type(FAR if k == 0 else 0.0))


@nb.njit(cache=True, error_model="numpy")
def fill(points, rows, image, integers, cell, patch, runs, buf, begin):
    """Fill a buffer with everything around a patch of cells.

    Parameters
    ----------
    points : tuple of 3 ndarray
        Packed points in cell order, their columns, first place of every cell.
    rows : tuple of 2 int
        Numbers of vectors and of scalars in the rows of the packed points (see :func:`gather_rows`).
    image : int
        See :func:`row_runs`.
    integers, cell : ndarray
        Grid integers and cell extent.
    patch : Patch
        The cells.
    runs : Runs
        Filled with where the entries come from.
    buf : ndarray, shape (rows, room)
        Filled.
    begin : ndarray, shape (SLABS * ROWS + 1,), int
        Filled with the first entry of every row, slab after slab (see :func:`piece`).

    Returns
    -------
    int
        Number of entries.
    """
    packed, column, start = points
    vectors, scalars = rows
    centre = centre_of(patch)
    slabs, across = slabs_and_rows(patch)
    m = 0
    for slab in range(slabs):
        here, count = runs.rows[slab], 0
        for row in range(across):
            begin[slab * across + row] = m
            y, z = patch.y0 - patch.reach_y + row, patch.z0 - REACH + slab
            first, count = count, row_runs(start, integers, patch.x, y, z, centre, image, here, count)
            m = gather_rows(packed, column, here, first, count, cell, vectors, scalars, buf, m)
        runs.count[slab] = count
    begin[slabs * across] = m
    _pad(buf, m)
    return m


@nb.njit(cache=True, error_model="numpy")
def piece(begin, patch, slab, row):
    """Return the first entry of what a slab holds around a cell, and the one after the last.

    ``row`` is the first one around the cell.
    """
    at = slab * (patch.y1 - patch.y0 + 2 * patch.reach_y) + row
    return begin[at], begin[at + 2 * patch.reach_y + 1]


@nb.njit(cache=True, error_model="numpy")
def aligned_rows(rows, room, like):
    """Return an uninitialised array (rows, room) of the type of ``like``, every row at a cache line.

    ``room`` is a multiple of a block, as :func:`buffer_room` gives it.
    """
    size = like.itemsize
    flat = np.empty(rows * room + _LINE // size, like.dtype)
    skip = (-flat.ctypes.data % _LINE) // size
    return flat[skip : skip + rows * room].reshape((rows, room))


@nb.njit(cache=True, error_model="numpy")
def slab_space():
    """Return room for the first entry of every row of a buffer and for the runs of memory."""
    runs = Runs(np.empty((SLABS, MOST_RUNS, 6), np.int64), np.empty(SLABS, np.int64))
    return np.empty(SLABS * ROWS + 1, np.int64), runs


def buffer_room(start: np.ndarray, integers: np.ndarray) -> int:
    """Return a buffer length that holds the surroundings of any patch, padding included.

    Parameters
    ----------
    start, integers : ndarray
        As in :func:`~cwmav_sim.sph.patches.fullest`.
    """
    entries = fullest(start, integers) + PADDING + BLOCK
    return entries + (_STEP - entries) % _PAGE
