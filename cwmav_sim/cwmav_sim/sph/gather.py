# SPDX-License-Identifier: Apache-2.0
"""Copy everything around a group of cells into one contiguous buffer.

Points are stored in cell order with coordinates relative to the centre of their own cell, so single
precision suffices however large the box is. A buffer holds coordinates relative to the centre of the first
cell of the group; periodic images and mirror images appear in it as ordinary entries.
"""

from __future__ import annotations

import numba as nb
import numpy as np

REACH = 2
PADDING = 64  # entries; a multiple of the widest unrolled vector loop
FAR = 1.0e3  # metres; padding entries lie here, outside every support
MOST_RUNS = 80

# Columns of a run: first and last place, shift in x [cells], shift in y and z [cells], sign of y.
FIRST, LAST, SHIFT_X, SHIFT_Y, SHIFT_Z, SIGN = range(6)


@nb.njit(cache=True, error_model="numpy")
def neighbour_runs(start, integers, cx0, cx1, cy, cz, runs):
    """List the contiguous runs of points around cells cx0 .. cx1 of row (cy, cz); return runs and points."""
    nx, ny, nz, mirrored, reach_y = integers[0], integers[1], integers[2], integers[3], integers[4]
    count = 0
    points = 0
    for dz in range(-REACH, REACH + 1):
        kz = (cz + dz) % nz
        for dy in range(-reach_y, reach_y + 1):
            ky = cy + dy
            sign = 1
            if mirrored:
                if ky < 0:
                    ky, sign = -1 - ky, -1
                elif ky >= ny:
                    ky, sign = 2 * ny - 1 - ky, -1
            else:
                ky %= ny
            row = (kz * ny + ky) * nx
            x = cx0 - REACH
            while x <= cx1 + REACH:
                image = x // nx
                end = min(cx1 + REACH, (image + 1) * nx - 1)
                first, last = start[row + x - image * nx], start[row + end - image * nx + 1]
                if last > first:
                    runs[count, FIRST] = first
                    runs[count, LAST] = last
                    runs[count, SHIFT_X] = image * nx - cx0
                    runs[count, SHIFT_Y] = dy
                    runs[count, SHIFT_Z] = dz
                    runs[count, SIGN] = sign
                    count += 1
                    points += last - first
                x = end + 1
    return count, points


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def gather_rows(packed, column, runs, count, cell, vectors, scalars, buf):
    """Copy the points of the runs into ``buf`` and return how many there are.

    Parameters
    ----------
    packed : ndarray, shape (3 * vectors + scalars, n)
        Position, then further vectors, then scalars, in cell order.
    column : ndarray, shape (n,)
        x index of the cell of each point, in the precision of the pairs.
    runs, count : ndarray, int
        From :func:`neighbour_runs`.
    cell : ndarray, shape (3,)
        Extent of a cell [m], in the precision of the pairs.
    vectors, scalars : int
        How the rows of ``packed`` divide; the y component of every vector changes sign in a mirror.
    buf : ndarray, shape (rows, m)
        Filled from entry 0.
    """
    m = 0
    for run in range(count):
        first, last = runs[run, FIRST], runs[run, LAST]
        length = last - first
        sign = cell.dtype.type(runs[run, SIGN])
        shift_x = cell.dtype.type(runs[run, SHIFT_X])
        shift_y = cell.dtype.type(runs[run, SHIFT_Y]) * cell[1]
        shift_z = cell.dtype.type(runs[run, SHIFT_Z]) * cell[2]
        for j in range(length):
            buf[0, m + j] = packed[0, first + j] + (column[first + j] + shift_x) * cell[0]
            buf[1, m + j] = sign * packed[1, first + j] + shift_y
            buf[2, m + j] = packed[2, first + j] + shift_z
        for k in range(1, vectors):
            for j in range(length):
                buf[3 * k, m + j] = packed[3 * k, first + j]
                buf[3 * k + 1, m + j] = sign * packed[3 * k + 1, first + j]
                buf[3 * k + 2, m + j] = packed[3 * k + 2, first + j]
        for k in range(3 * vectors, 3 * vectors + scalars):
            for j in range(length):
                buf[k, m + j] = packed[k, first + j]
        m += length
    return m


@nb.njit(cache=True, error_model="numpy")
def pad(buf, used, filler):
    """Fill up to a whole number of vector loops with copies of ``filler`` and return the padded length."""
    end = (used + PADDING - 1) // PADDING * PADDING
    for k in range(buf.shape[0]):
        for j in range(used, end):
            buf[k, j] = filler[k]
    return end


@nb.njit(cache=True, error_model="numpy")
def largest_buffer(start, integers, width):
    """Return the padded length that holds the surroundings of any group of ``width`` cells."""
    nx, ny, nz = integers[0], integers[1], integers[2]
    most = 0
    runs = np.empty((MOST_RUNS, 6), np.int64)
    for row in range(ny * nz):
        for cx in range(0, nx, width):
            _, points = neighbour_runs(
                start, integers, cx, min(cx + width, nx) - 1, row % ny, row // ny, runs
            )
            most = max(most, points)
    return (most + PADDING - 1) // PADDING * PADDING
