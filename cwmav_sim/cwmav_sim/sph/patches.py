# SPDX-License-Identifier: Apache-2.0
"""Cells that are worked on together, and how they are dealt to threads.

A *patch* is a sheet of cells at one x: some along y, more along z. What surrounds it is copied into one
buffer (see ``gather``), slab by slab in z and row by row in y, so a cell shares most of what is around it
with the others. Patches are dealt to a fixed number of chunks, so results do not depend on how many threads
there are or on their order.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from cwmav_sim.sph.cells import REACH

WIDTH = 6  # cells of a patch along y, at most
HEIGHT = 16  # cells of a patch along z, at most
ROWS, SLABS = WIDTH + 2 * REACH, HEIGHT + 2 * REACH
CHUNKS = 64  # independent parts of a pass; a power of two
HAND = 2  # patches that a part gets at once


class Patch(NamedTuple):
    """Cells worked on together.

    Attributes
    ----------
    x : int
        Index of its cells along x.
    y0, y1, z0, z1 : int
        First index along y and z, and the one after the last.
    reach_y : int
        Cells within reach on either side along y: none in two dimensions.
    """

    x: int
    y0: int
    y1: int
    z0: int
    z1: int
    reach_y: int


@nb.njit(cache=True, error_model="numpy")
def share(integers):
    """Return how many patches are dealt to a chunk; the last ones may lie beyond the grid."""
    return -(-_total(integers) // (CHUNKS * HAND)) * HAND


@nb.njit(cache=True, error_model="numpy")
def dealt(integers, chunk, turn):
    """Return the number of the patch that a chunk gets at its turn, or -1 beyond the grid.

    Neighbours are dealt to the same chunk, a hand at a time: they copy much the same points. Threads take
    chunks one after the other, a contiguous part each, so the hands beside each other go to chunks far
    apart: patches near walls, which take longer, are then shared evenly.
    """
    own, turns = _reversed(np.int64(chunk)), np.int64(turn)  # loop variables may be of either kind
    number = (turns // HAND * CHUNKS + own) * HAND + turns % HAND
    return number if number < _total(integers) else -1


@nb.njit(cache=True, error_model="numpy")
def _reversed(chunk):
    """Return the number of a chunk with its binary digits in the opposite order."""
    out, left, rest = np.int64(0), chunk, CHUNKS - 1
    while rest > 0:
        out, left, rest = 2 * out + left % 2, left // 2, rest // 2
    return out


@nb.njit(cache=True, error_model="numpy")
def _parts(integers):
    """Return into how many patches the cells at one x are cut along y and z; they are as equal as can be."""
    return (integers[1] + WIDTH - 1) // WIDTH, (integers[2] + HEIGHT - 1) // HEIGHT


@nb.njit(cache=True, error_model="numpy")
def _total(integers):
    across, up = _parts(integers)
    return integers[0] * across * up


@nb.njit(cache=True, error_model="numpy")
def patch_of(integers, number):
    """Return the patch of a number, which counts x fastest, then y."""
    nx, ny, nz = integers[0], integers[1], integers[2]
    across, up = _parts(integers)
    y, z = number // nx % across, number // (nx * across)
    return Patch(
        number % nx, y * ny // across, (y + 1) * ny // across, z * nz // up, (z + 1) * nz // up, integers[4]
    )


@nb.njit(cache=True, error_model="numpy")
def centre_of(patch):
    """Return the indices along y and z of the cell on which the buffer of a patch is centred."""
    return (patch.y0 + patch.y1) // 2, (patch.z0 + patch.z1) // 2


@nb.njit(cache=True, error_model="numpy")
def slabs_and_rows(patch):
    """Return how many slabs there are around a patch, and how many rows in each."""
    return patch.z1 - patch.z0 + 2 * REACH, patch.y1 - patch.y0 + 2 * patch.reach_y


@nb.njit(cache=True, error_model="numpy")
def cells_in(patch):
    """Return the number of cells of a patch."""
    return (patch.y1 - patch.y0) * (patch.z1 - patch.z0)


@nb.njit(cache=True, error_model="numpy")
def cell_of(patch, member, integers, cell):
    """Return one of the cells of a patch.

    Returns
    -------
    number : int
        Of the cell in the grid.
    window : tuple of 2 int
        First slab and first row of what is around it.
    offset : tuple of 2 floats
        Its place along y and z with respect to the centre of the patch [m], in the precision of ``cell``.
    """
    height = patch.z1 - patch.z0
    row, slab = member // height, member % height
    y, z = centre_of(patch)
    number = ((patch.z0 + slab) * integers[1] + patch.y0 + row) * integers[0] + patch.x
    kind = cell.dtype.type
    offset = kind(patch.y0 + row - y) * cell[1], kind(patch.z0 + slab - z) * cell[2]
    return number, (slab, row), offset


@nb.njit(cache=True, error_model="numpy")
def marked_slabs(cells, integers, patch):
    """Return the first slab around the marked cells of a patch and the one after the last.

    Both are the same where no cell is marked in ``cells``, shape (cells,), bool.
    """
    first, last = patch.z1, patch.z1
    for cz in range(patch.z0, patch.z1):
        for cy in range(patch.y0, patch.y1):
            if cells[(cz * integers[1] + cy) * integers[0] + patch.x]:
                first, last = min(first, cz), cz + 2 * REACH + 1
    return first - patch.z0, last - patch.z0


@nb.njit(cache=True, error_model="numpy")
def any_marked(cells, integers, patch):
    """Return whether any cell of a patch is marked in ``cells``, shape (cells,), bool."""
    slabs = marked_slabs(cells, integers, patch)
    return slabs[1] > slabs[0]


def fullest(start: np.ndarray, integers: np.ndarray) -> int:
    """Return how many points lie around a patch, at most.

    No patch has more around it than lies in the columns of cells around its own, or twice that where it
    reaches around the box along z.

    Parameters
    ----------
    start : ndarray, shape (cells + 1,) or (sets, cells + 1), int
        First place of every cell, of one set of points or several.
    integers : ndarray
        Grid integers.
    """
    return int(_fullest(np.atleast_2d(start), integers))


@nb.njit(cache=True, error_model="numpy")
def _columns(first, integers):
    """Return how many points lie in every column of cells along z and those within reach in x, (ny, nx)."""
    nx, ny, nz = integers[0], integers[1], integers[2]
    columns, out = np.zeros((ny, nx), np.int64), np.zeros((ny, nx), np.int64)
    for row in range(ny * nz):
        for cx in range(nx):
            columns[row % ny, cx] += first[row * nx + cx + 1] - first[row * nx + cx]
    for cy in range(ny):
        for cx in range(nx):
            for x in range(cx - REACH, cx + REACH + 1):
                out[cy, cx] += columns[cy, x + (nx if x < 0 else (-nx if x >= nx else 0))]
    return out


@nb.njit(cache=True, error_model="numpy")
def _fullest(start, integers):
    nx, ny, nz, mirrored, reach_y = integers[0], integers[1], integers[2], integers[3], integers[4]
    across, up = _parts(integers)
    most = 0
    for points in range(start.shape[0]):
        within = _columns(start[points], integers)
        for number in range(nx * across):
            patch, total = patch_of(integers, number), 0
            for cy in range(patch.y0 - reach_y, patch.y1 + reach_y):
                ky = cy
                if mirrored:
                    ky = -1 - ky if ky < 0 else (2 * ny - 1 - ky if ky >= ny else ky)
                else:
                    ky += ny if ky < 0 else (-ny if ky >= ny else 0)
                total += within[ky, patch.x]
            most = max(most, total)
    slabs = -(-nz // up) + 2 * REACH
    return most * -(-slabs // nz)
