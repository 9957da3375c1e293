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

from cwmav_sim.sph.blocks import LANE_BYTES, count_lanes, lanes_within, ordered_lanes
from cwmav_sim.sph.gather import FAR, REACH, aligned_rows, slab_space

MULTIPLE = 16  # entries; the sums look at a multiple, at least what a vector loop takes at once


@nb.njit(cache=True, error_model="numpy")
def box_around(points, first, last, offset):
    """Return the middle and half the extent of the box round points ``first`` to ``last`` of a cell.

    Parameters
    ----------
    points : ndarray, shape (>= 3, n)
        Positions relative to the own cells [m], in cell order.
    first, last : int
        Points of the cell; at least one.
    offset : float
        Place of the cell along z with respect to the centre of its stretch [m].

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
    centre = (half * (x0 + x1), half * (y0 + y1), half * (z0 + z1) + offset)
    return centre, (half * (x1 - x0), half * (y1 - y0), half * (z1 - z0))


class Space(NamedTuple):
    """Room for what surrounds a stretch, and for what of it is within reach of a cell.

    Attributes
    ----------
    buf : ndarray, shape (rows, room)
        Everything around the stretch.
    begin : ndarray, shape (SLABS + 1,), int
        First entry of every slab.
    runs : Runs
        Where the entries come from.
    nearby : ndarray, shape (rows, room)
        What is within reach.
    kept : ndarray, shape (room, 2), uint64
        Which entries of the buffer these are.
    """

    buf: Any
    begin: Any
    runs: Any
    nearby: Any
    kept: Any


@nb.njit(cache=True, error_model="numpy")
def space(rows, room, like):
    """Return room for ``rows`` values of up to ``room`` entries, of the type of ``like``."""
    begin, runs = slab_space()
    buf, nearby = aligned_rows(rows, room, like), aligned_rows(rows, room, like)
    return Space(buf, begin, runs, nearby, np.empty((room, 2), np.uint64))


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def keep_nearby(buf, rows, begin, slab, box, reach2, orders, out, kept):
    """Copy the entries of a window that lie within reach of a box, in their order.

    Parameters
    ----------
    buf, begin : ndarray
        Buffer and the first entry of its slabs, from :func:`~cwmav_sim.sph.gather.fill`.
    rows : int
        Number of rows, the first three of which are positions.
    slab : int
        First slab of the window.
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
        Number of entries, padding included: a multiple of :data:`MULTIPLE`.
    int
        Number of looks.
    """
    lanes = LANE_BYTES // buf.itemsize
    first, last = begin[slab] // lanes * lanes, begin[slab + 2 * REACH + 1]
    entries, looks = 0, 0
    for at in range(first, last, lanes):
        bits = lanes_within(buf, at, box[0], box[1], reach2)
        order = orders[bits]
        for row in range(rows):
            ordered_lanes(out, entries, buf, at, row, order)
        kept[looks, 0], kept[looks, 1] = at, bits
        looks += 1
        entries += count_lanes(bits)
    _pad(out, rows, entries)
    return (entries + MULTIPLE - 1) // MULTIPLE * MULTIPLE, looks


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def keep_same(buf, row, kept, looks, orders, out):
    """Copy of one row of another buffer the entries that :func:`keep_nearby` kept; pad with zeros."""
    entries = 0
    for look in range(looks):
        bits = kept[look, 1]
        ordered_lanes(out, entries, buf, np.int64(kept[look, 0]), row, orders[bits])
        entries += count_lanes(bits)
    zero = out.dtype.type(0.0)
    for j in range(entries, entries + MULTIPLE):
        out[row, j] = zero


@nb.njit(cache=True, error_model="numpy", forceinline=True)
def _pad(out, rows, entries):
    """Put harmless entries far away behind the ones in use."""
    for row in range(rows):
        value = out.dtype.type(FAR if row == 0 else 0.0)
        for j in range(entries, entries + MULTIPLE):
            out[row, j] = value


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
