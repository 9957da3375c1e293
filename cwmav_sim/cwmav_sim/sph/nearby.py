# SPDX-License-Identifier: Apache-2.0
"""Keep of what surrounds a cell only the entries within reach of its particles.

A window of a buffer (see ``gather``) holds everything within two cells, four times what lies within the
support of one particle. Before the sums, its entries within reach of the box round the particles of the cell
are copied together: two fifths of the window, looked at by every particle of the cell.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba as nb
import numpy as np

from cwmav_sim.sph.blocks import BLOCK, copy_lanes, count_lanes, lanes_of, lanes_within, set_block
from cwmav_sim.sph.cells import REACH
from cwmav_sim.sph.gather import FAR, aligned_rows, piece, slab_space

_APART = 3  # rows that are left out before those to work with


@nb.njit(cache=True, error_model="numpy")
def box_around(points, first, last, offset):
    """Return the middle and half the extent of the box round points ``first`` to ``last`` of a cell.

    Parameters
    ----------
    points : ndarray, shape (>= 3, n)
        Positions relative to the own cells [m], in cell order.
    first, last : int
        Points of the cell; at least one.
    offset : tuple of 2 floats
        Place of the cell along y and z with respect to the centre of its patch [m].

    Returns
    -------
    tuple of 2 tuples of 3 floats
    """
    x0, y0, z0 = points[0, first], points[1, first], points[2, first]
    x1, y1, z1 = x0, y0, z0
    for i in range(first + 1, last):
        x, y, z = points[0, i], points[1, i], points[2, i]
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    half = points.dtype.type(0.5)
    centre = (half * (x0 + x1), half * (y0 + y1) + offset[0], half * (z0 + z1) + offset[1])
    return centre, (half * (x1 - x0), half * (y1 - y0), half * (z1 - z0))


class Space(NamedTuple):
    """Room for what surrounds a patch, and for what of it is within reach of a cell.

    Attributes
    ----------
    buf : ndarray, shape (rows, room)
        Everything around the patch.
    begin : ndarray, shape (SLABS * ROWS + 1,), int
        First entry of every row.
    runs : Runs
        Where the entries come from.
    nearby : ndarray, shape (rows, room)
        What is within reach.
    kept : ndarray, shape (room, 2), uint64
        Which entries of the buffer these are.
    work : ndarray, shape (more, room)
        Whatever else is needed for every entry.
    """

    buf: Any
    begin: Any
    runs: Any
    nearby: Any
    kept: Any
    work: Any


@nb.njit(cache=True, error_model="numpy")
def space(rows, more, room, like):
    """Return room for ``rows`` values of up to ``room`` entries and ``more`` to work with.

    All are of the type of ``like``. Work lies apart in the cache from what is read with it.
    """
    begin, runs = slab_space()
    every = aligned_rows(2 * rows + _APART + more, room, like)
    buf, nearby, work = every[:rows], every[rows : 2 * rows], every[2 * rows + _APART :]
    return Space(buf, begin, runs, nearby, np.empty((room, 2), np.uint64), work)


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def _list_looks(buf, begin, patch, window, box, reach2, kept):
    """List the looks that find anything; every fourth finds nothing."""
    lanes = lanes_of(buf)
    looks, at = np.uint64(0), 0  # an index without a sign needs no check
    for slab in range(window[0], window[0] + 2 * REACH + 1):
        first, last = piece(begin, patch, slab, window[1])
        # Entries beside the piece that are looked at with it lie out of reach; none is looked at twice.
        at = max(at, first // lanes * lanes)
        while at < last:
            bits = lanes_within(buf, at, box[0], box[1], reach2)
            kept[looks, 0], kept[looks, 1] = at, bits
            looks += np.uint64(1) if bits != np.uint64(0) else np.uint64(0)
            at += lanes
    return looks


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def keep_nearby(buf, rows, begin, patch, window, box, reach2, orders, out, kept):
    """Copy the entries of a window that lie within reach of a box, in their order.

    Parameters
    ----------
    buf, begin : ndarray
        Buffer and the first entry of its rows, from :func:`~cwmav_sim.sph.gather.fill`.
    rows : int
        Number of rows, the first three of which are positions.
    patch : Patch
        The cells it was filled for.
    window : tuple of 2 int
        First slab and first row of the window.
    box : tuple
        From :func:`box_around`.
    reach2 : float
        Square of the reach [m2], in the precision of the pairs.
    orders : ndarray
        From :func:`~cwmav_sim.sph.blocks.lane_orders`.
    out : ndarray, shape (rows, room)
        Filled, and behind that padded with entries that count for nothing.
    kept : ndarray, shape (room, 2), uint64
        Filled with the first entry of every look and the set of lanes that was kept of it.

    Returns
    -------
    int
        Number of entries, padding included: a multiple of what :func:`multiple` says.
    int
        Number of looks.
    """
    looks = _list_looks(buf, begin, patch, window, box, reach2, kept)
    entries = 0
    for look in range(looks):
        bits = kept[look, 1]
        copy_lanes(out, entries, buf, np.int64(kept[look, 0]), (0, rows), bits, orders)
        entries += count_lanes(bits)
    for row in range(rows):
        _pad(out, row, entries, FAR if row == 0 else 0.0)
    size = multiple(out)
    return (entries + size - 1) // size * size, looks


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def keep_same(buf, row, kept, looks, orders, out):
    """Copy of one row of another buffer the entries that :func:`keep_nearby` kept; pad with zeros."""
    entries = 0
    for look in range(looks):
        bits = kept[look, 1]
        copy_lanes(out, entries, buf, np.int64(kept[look, 0]), (row, row + 1), bits, orders)
        entries += count_lanes(bits)
    _pad(out, row, entries, 0.0)


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def multiple(array):
    """Return of what the number of entries that are looked at is a multiple: two vectors, or a block.

    Loops take two vectors at once; what is left over would be looked at four by four.
    """
    return max(2 * lanes_of(array), BLOCK)


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def _pad(out, row, entries, value):
    """Put harmless entries behind the ones in use."""
    for more in range(0, multiple(out), BLOCK):
        set_block(out, row, entries + more, out.dtype.type(value))


@nb.njit(cache=True, error_model="numpy")
def add_back(source, kept, looks, target):
    """Add what was summed on kept entries to the entries of the buffer they were kept of, row by row."""
    entries = 0
    for look in range(looks):
        at, bits = np.int64(kept[look, 0]), kept[look, 1]
        while bits != np.uint64(0):
            if bits & np.uint64(1):
                for row in range(source.shape[0]):
                    target[row, at] += source[row, entries]
                entries += 1
            bits >>= np.uint64(1)
            at += 1
