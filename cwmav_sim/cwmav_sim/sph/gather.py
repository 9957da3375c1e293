# SPDX-License-Identifier: Apache-2.0
"""Copy everything around a stretch of cells into one contiguous buffer.

Points are stored in cell order, x fastest, with coordinates relative to the centre of their own cell, so
single precision suffices however large the box is. A buffer belongs to a stretch of cells along z at one
(cx, cy). It is filled slab by slab: slab k holds the points of the cells within reach in x and y at z index
k, in a few runs of memory each. What surrounds one cell of the stretch is then the contiguous window of the
slabs within its reach, and every slab is copied once although it serves several cells. Coordinates in the
buffer are relative to the centre of the stretch; periodic images and mirror images are ordinary entries.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba as nb
import numpy as np

from cwmav_sim.sph.blocks import BLOCK, add_block, scaled_block

REACH = 2
STRETCH = 16  # cells along z that share a buffer, at most
SLABS = STRETCH + 2 * REACH
CHUNKS = 64  # independent parts of a pass; a power of two
HAND = 8  # stretches that a part gets at once
PADDING = BLOCK  # entries behind the last, which may be looked at together with it
FAR = 1.0e3  # metres; padding entries lie here, outside every support
_LINE = 64  # bytes of a cache line
MOST_RUNS = 40  # of a slab: rows within reach in y, each cut at most a few times by periodic faces
ANY_IMAGE = 0  # points as they are and mirror images alike

# Columns of a run: first and last place, shift in x, y and z [cells], sign of y.
FIRST, LAST, SHIFT_X, SHIFT_Y, SHIFT_Z, SIGN = range(6)


class Runs(NamedTuple):
    """Runs of memory around a stretch, slab by slab.

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
def slab_runs(start, integers, cx, cy, cz, dz, image, runs):
    """List the contiguous runs of points around cell (cx, cy) at z index cz + dz; return their number.

    ``dz`` [cells] is also the shift in z of the runs. ``image`` 1 takes the points themselves, -1 their
    mirror images and :data:`ANY_IMAGE` both. Whatever is around lies within one period of the box, because a
    grid has more cells along a periodic axis than a surrounding (:func:`cwmav_sim.sph.cells.make_grid`).
    """
    nx, ny, nz, mirrored, reach_y = integers[0], integers[1], integers[2], integers[3], integers[4]
    count = 0
    kz = cz + dz
    kz += nz if kz < 0 else (-nz if kz >= nz else 0)  # no division: it takes longer than a copy
    for dy in range(-reach_y, reach_y + 1):
        ky = cy + dy
        sign = 1
        if mirrored:
            if ky < 0:
                ky, sign = -1 - ky, -1
            elif ky >= ny:
                ky, sign = 2 * ny - 1 - ky, -1
        else:
            ky += ny if ky < 0 else (-ny if ky >= ny else 0)
        if sign == -image:
            continue
        row = (kz * ny + ky) * nx
        x = cx - REACH
        while x <= cx + REACH:
            lap = -1 if x < 0 else (1 if x >= nx else 0)
            end = min(cx + REACH, (lap + 1) * nx - 1)
            first, last = start[row + x - lap * nx], start[row + end - lap * nx + 1]
            if last > first:
                runs[count, FIRST] = first
                runs[count, LAST] = last
                runs[count, SHIFT_X] = lap * nx - cx
                runs[count, SHIFT_Y] = dy
                runs[count, SHIFT_Z] = dz
                runs[count, SIGN] = sign
                count += 1
            x = end + 1
    return count


@nb.njit(cache=True, error_model="numpy")
def gather_rows(packed, column, runs, count, cell, vectors, scalars, buf, m):
    """Copy the points of the runs into ``buf`` from entry ``m`` on and return the entry after the last.

    Parameters
    ----------
    packed : ndarray, shape (3 * vectors + scalars, n)
        Position, then further vectors, then scalars, in cell order.
    column : ndarray, shape (n,)
        x index of the cell of each point, in the precision of the pairs.
    runs, count : ndarray, int
        From :func:`slab_runs`.
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
    for run in range(count):
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
        value = buf.dtype.type(FAR if k == 0 else 0.0)
        for j in range(used, used + PADDING):
            buf[k, j] = value


@nb.njit(cache=True, error_model="numpy")
def fill(points, rows, image, integers, cell, place, runs, buf, begin):
    """Fill a buffer with everything around a stretch of cells.

    Parameters
    ----------
    points : tuple of 3 ndarray
        Packed points in cell order, their columns, first place of every cell.
    rows : tuple of 2 int
        Numbers of vectors and of scalars in the rows of the packed points (see :func:`gather_rows`).
    image : int
        See :func:`slab_runs`.
    integers, cell : ndarray
        Grid integers and cell extent.
    place : tuple of 5 int
        From :func:`stretch`.
    runs : Runs
        Filled with where the entries come from.
    buf : ndarray, shape (rows, room)
        Filled.
    begin : ndarray, shape (SLABS + 1,), int
        Filled with the first entry of every slab.
    """
    packed, column, start = points
    vectors, scalars = rows
    cx, cy, z0, z1, centre = place
    m = 0
    slabs = z1 - z0 + 2 * REACH
    for slab in range(slabs):
        begin[slab] = m
        here = runs.rows[slab]
        count = slab_runs(start, integers, cx, cy, centre, z0 - REACH + slab - centre, image, here)
        runs.count[slab] = count
        m = gather_rows(packed, column, here, count, cell, vectors, scalars, buf, m)
    begin[slabs] = m
    _pad(buf, m)


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
    """Return room for the first entry of every slab of a buffer and for the runs of memory."""
    runs = Runs(np.empty((SLABS, MOST_RUNS, 6), np.int64), np.empty(SLABS, np.int64))
    return np.empty(SLABS + 1, np.int64), runs


@nb.njit(cache=True, error_model="numpy")
def share(integers):
    """Return how many stretches are dealt to a chunk; the last ones may lie beyond the grid."""
    total = integers[0] * integers[1] * _parts(integers)
    return -(-total // (CHUNKS * HAND)) * HAND


@nb.njit(cache=True, error_model="numpy")
def dealt(integers, chunk, turn):
    """Return the number of the stretch that a chunk gets at its turn, or -1 beyond the grid.

    Neighbours are dealt to the same chunk, a handful at a time: they copy much the same points. Threads take
    chunks one after the other, a contiguous part each, so the handfuls beside each other go to chunks far
    apart: stretches near walls, which take longer, are then shared evenly.
    """
    own, turns = _reversed(np.int64(chunk)), np.int64(turn)  # loop variables may be of either kind
    number = (turns // HAND * CHUNKS + own) * HAND + turns % HAND
    return number if number < integers[0] * integers[1] * _parts(integers) else -1


@nb.njit(cache=True, error_model="numpy")
def _reversed(chunk):
    """Return the number of a chunk with its binary digits in the opposite order."""
    out, left, rest = np.int64(0), chunk, CHUNKS - 1
    while rest > 0:
        out, left, rest = 2 * out + left % 2, left // 2, rest // 2
    return out


@nb.njit(cache=True, error_model="numpy")
def _parts(integers):
    """Return into how many stretches a column of cells is cut; they are as equal as can be."""
    return (integers[2] + STRETCH - 1) // STRETCH


@nb.njit(cache=True, error_model="numpy")
def stretch(integers, number):
    """Return the place of a stretch: x, y, first z, the z after the last, and the z it is centred on."""
    nx, ny, nz, parts = integers[0], integers[1], integers[2], _parts(integers)
    part = number // (nx * ny)
    z0, z1 = part * nz // parts, (part + 1) * nz // parts
    return number % nx, number // nx % ny, z0, z1, (z0 + z1) // 2


@nb.njit(cache=True, error_model="numpy")
def marked_slabs(cells, integers, place):
    """Return the first slab around the marked cells of a stretch and the one after the last.

    Both are the same where no cell is marked in ``cells``, shape (cells,), bool.
    """
    cx, cy, z0, z1, _ = place
    first, last = z1, z1
    for cz in range(z0, z1):
        if cells[(cz * integers[1] + cy) * integers[0] + cx]:
            first, last = min(first, cz), cz + 2 * REACH + 1
    return first - z0, last - z0


@nb.njit(cache=True, error_model="numpy")
def any_marked(cells, integers, place):
    """Return whether any cell of a stretch is marked in ``cells``, shape (cells,), bool."""
    cx, cy, z0, z1, _ = place
    for cz in range(z0, z1):  # noqa: SIM110 - no generators in compiled code
        if cells[(cz * integers[1] + cy) * integers[0] + cx]:
            return True
    return False


def buffer_room(start: np.ndarray, integers: np.ndarray) -> int:
    """Return a buffer length that holds the surroundings of any stretch, padding included.

    No stretch has more around it than lies in the columns of cells around its own, or twice that where it
    reaches around the box. Room is asked for in every pass, and memory that is never looked at costs time
    too. The length is an odd number of blocks: rows of a power of two would all fall into the same places of
    the cache.

    Parameters
    ----------
    start : ndarray, shape (cells + 1,) or (sets, cells + 1), int
        First place of every cell, of one set of points or several.
    integers : ndarray
        Grid integers.
    """
    entries = int(_fullest(np.atleast_2d(start), integers)) + PADDING + BLOCK
    return (-(-entries // BLOCK) | 1) * BLOCK


@nb.njit(cache=True, error_model="numpy")
def _fullest(start, integers):
    nx, ny, nz, mirrored, reach_y = integers[0], integers[1], integers[2], integers[3], integers[4]
    columns = np.empty((ny, nx), np.int64)
    most = 0
    for points in range(start.shape[0]):
        columns[:] = 0
        for row in range(ny * nz):
            for cx in range(nx):
                columns[row % ny, cx] += start[points, row * nx + cx + 1] - start[points, row * nx + cx]
        for cy in range(ny):
            for cx in range(nx):
                around = 0
                for dy in range(-reach_y, reach_y + 1):
                    ky = cy + dy
                    if mirrored:
                        ky = -1 - ky if ky < 0 else (2 * ny - 1 - ky if ky >= ny else ky)
                    for dx in range(-REACH, REACH + 1):
                        around += columns[ky % ny, (cx + dx) % nx]
                most = max(most, around)
    slabs = -(-nz // _parts(integers)) + 2 * REACH
    return most * -(-slabs // nz)
