# SPDX-License-Identifier: Apache-2.0
"""Which points lie around a point: rows of cells along x, each one run of memory.

A row is cut to the cells that the support of the point really meets, and again where it goes around a
periodic face.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda

from cwmav_sim.cuda.cells import (
    HALF,
    MIRRORED,
    NX,
    NY,
    NZ,
    PER_CELL_X,
    ZERO,
)

REACH = 2  # cells on either side that hold the support


@cuda.jit(device=True)
def layer(integers, cz, dz):
    """Return the number of the first row of a layer of cells, ``dz`` above that of ``cz``."""
    ny, nz = integers[NY], integers[NZ]
    kz = cz + dz
    if kz < 0:
        kz += nz
    elif kz >= nz:
        kz -= nz
    return np.int32(kz * ny)


@cuda.jit(device=True)
def row(integers, first_row, cy, dy):
    """Return the number of the first cell of a row, and -1 if the row is a mirror image, otherwise 1."""
    nx, ny = integers[NX], integers[NY]
    sign = 1
    ky = cy + dy
    if integers[MIRRORED] != 0:
        if ky < 0:
            ky = -1 - ky
            sign = -1
        elif ky >= ny:
            ky = 2 * ny - 1 - ky
            sign = -1
    elif ky < 0:
        ky += ny
    elif ky >= ny:
        ky -= ny
    return np.int32((first_row + ky) * nx), np.int32(sign)


@cuda.jit(device=True)
def left_beyond(room, reach, cell, offset, shift):
    """Return what is left of a squared reach beyond the gap to cells ``shift`` away along one axis.

    Parameters
    ----------
    room : float
        Squared reach before [m2].
    reach : tuple
        Of the grid.
    cell, offset : float
        Extent of a cell and position relative to the centre of the own cell along the axis [m].
    shift : float
        How many cells the others lie away.
    """
    gap = max(abs(shift * cell - offset) - reach[HALF] * cell, reach[ZERO])
    return room - gap * gap


@cuda.jit(device=True)
def extent(reach, x, room):
    """Return the cells that the support meets in a row, as first and last offset along x.

    Parameters
    ----------
    reach : tuple
        Of the grid.
    x : float
        Position relative to the centre of the own cell [m].
    room : float
        What is left of the squared support beyond the gap to the row [m2], above zero.
    """
    half = reach[HALF]
    width = math.sqrt(room)
    first = np.int32(math.floor((x - width) * reach[PER_CELL_X] + half))
    last = np.int32(math.floor((x + width) * reach[PER_CELL_X] + half))
    low, high = np.int32(-REACH), np.int32(REACH)
    return (low if first < low else first), (high if last > high else last)


@cuda.jit(device=True)
def laps(nx, low, high):
    """Return the first and the last lap that the cells ``low``..``high`` of a row lie in."""
    first = np.int32(-1) if low < 0 else np.int32(0)
    last = np.int32(1) if high >= nx else np.int32(0)
    return first, last


@cuda.jit(device=True)
def run(start, base, nx, low, high, lap):
    """Return the places, first and one after the last, of the cells ``low``..``high`` of a row within a lap.

    Lap 0 is the box itself, -1 and 1 are its periodic images below and above.
    """
    if lap == 0 and low >= 0 and high < nx:  # almost every row
        return np.uint32(start[base + low]), np.uint32(start[base + high + 1])
    first = max(low, lap * nx)
    last = min(high, lap * nx + nx - 1)
    if first > last:
        return np.uint32(0), np.uint32(0)
    return np.uint32(start[base + first - lap * nx]), np.uint32(start[base + last - lap * nx + 1])
