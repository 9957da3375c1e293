# SPDX-License-Identifier: Apache-2.0
"""Walls around a patch of cells, and those of their elements within reach of one cell.

Beside the buffer of neighbours (see ``gather``) a patch near walls has, per channel, a buffer of the
elements of a wall or of its mirror image, and the distances of neighbours and elements from all walls. For
every cell the entries within reach are copied together (see ``nearby``).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba as nb
import numpy as np

from cwmav_sim.sph.gather import FIRST, LAST, MOST_RUNS, PADDING, Runs, aligned_rows, fill, piece
from cwmav_sim.sph.nearby import add_back, keep_nearby, keep_same
from cwmav_sim.sph.patches import ROWS, SLABS, any_marked, slabs_and_rows
from cwmav_sim.sph.visibility import count_sides, gather_sides
from cwmav_sim.sph.wall import ELEMENT_ROWS, ELEMENTS

REACTION_SIZE = 4  # force on an element, and the mass of air it carries along


class Sides(NamedTuple):
    """Distances of the entries of a buffer from every wall, and how many lie on either side of it.

    Attributes
    ----------
    signed, inside : ndarray, shape (channels, room)
        As in ``visibility``.
    below, above : ndarray, shape (channels,), int32
        Counts of negative and positive distances.
    """

    signed: Any
    inside: Any
    below: Any
    above: Any


class Walls(NamedTuple):
    """Elements of every wall around, channel by channel.

    Attributes
    ----------
    rows : ndarray, shape (channels, 11, room)
        Packed elements.
    signed, inside : ndarray, shape (channels, channels, room)
        Their distances from all walls.
    below, above : ndarray, shape (channels, channels), int32
        Counts of negative and positive distances.
    reaction : ndarray, shape (channels, 4, room)
        What particles return to them.
    begin : ndarray, shape (channels, SLABS * ROWS + 1), int
        First entry of every row around a patch.
    runs, counts : ndarray, shape (channels, slabs, most, 6) and (channels, slabs), int
        Where the entries of a patch come from (see ``gather.Runs``).
    entries : ndarray, shape (channels,), int
        Number of entries kept for a cell.
    kept, looks : ndarray, shape (channels, room, 2) and (channels,)
        Which entries of the patch these are.
    """

    rows: Any
    signed: Any
    inside: Any
    below: Any
    above: Any
    reaction: Any
    begin: Any
    runs: Any
    counts: Any
    entries: Any
    kept: Any
    looks: Any


@nb.njit(cache=True, error_model="numpy")
def side_space(channels, room, like):
    """Return room for the sides of ``room`` entries."""
    return Sides(
        aligned_rows(channels, room, like),
        aligned_rows(channels, room, like),
        np.zeros(channels, np.int32),
        np.zeros(channels, np.int32),
    )


@nb.njit(cache=True, error_model="numpy")
def wall_space(channels, room, like):
    """Return room for ``room`` elements of every wall."""
    square = (channels, channels, room)
    return Walls(
        aligned_rows(channels * ELEMENT_ROWS, room, like).reshape((channels, ELEMENT_ROWS, room)),
        aligned_rows(channels * channels, room, like).reshape(square),
        aligned_rows(channels * channels, room, like).reshape(square),
        np.zeros((channels, channels), np.int32),
        np.zeros((channels, channels), np.int32),
        np.empty((channels, REACTION_SIZE, room), like.dtype),
        np.empty((channels, SLABS * ROWS + 1), np.int64),
        np.empty((channels, SLABS, MOST_RUNS, 6), np.int64),
        np.empty((channels, SLABS), np.int64),
        np.zeros(channels, np.int64),
        np.empty((channels, room, 2), np.uint64),
        np.zeros(channels, np.int64),
    )


@nb.njit(cache=True, error_model="numpy")
def gather_walls(packed, sides, near, slabs, integers, cell, patch, returning, around, walls):
    """Fill the buffers of the walls around a patch.

    Parameters
    ----------
    packed : tuple of 3 ndarray
        Packed elements sorted by panel and cell, their columns, first places, shape (p, cells + 1).
    sides : tuple of 2 ndarray
        Distances ``signed`` and ``inside`` of the elements from the other walls, shape (channels, m).
    near : ndarray, shape (channels, cells), bool
        Cells that have elements of a wall around them.
    slabs : tuple of 2 int
        From :func:`~cwmav_sim.sph.patches.marked_slabs`; of others the distances are not needed.
    integers, cell : ndarray
        Grid integers and cell extent.
    patch : Patch
        The cells.
    returning : bool
        Whether particles will return reactions, which are set to zero then.
    around : ndarray, shape (channels,), bool
        Filled: which walls have elements around.
    walls : Walls
        Filled: rows, distances, ``begin`` and ``runs``.
    """
    rows, column, start = packed
    panels, channels = start.shape[0], around.shape[0]
    for channel in range(channels):
        # A wall without elements around here is out of reach of every particle of the patch.
        around[channel] = any_marked(near[channel], integers, patch)
        if not around[channel]:
            continue
        points, image = (rows, column, start[channel % panels]), 1 if channel < panels else -1
        buf, begin, runs = walls.rows[channel], walls.begin[channel], runs_of(walls, channel)
        entries = fill(points, ELEMENTS, image, integers, cell, patch, runs, buf, begin)
        if returning:
            walls.reaction[channel, :, : entries + PADDING] = 0.0
    for channel in range(channels):
        if around[channel] and _others(around, channel):
            begin, runs = walls.begin[channel], runs_of(walls, channel)
            signed, inside = walls.signed[channel], walls.inside[channel]
            gather_sides(sides[0], sides[1], begin, patch, runs, slabs, panels, around, signed, inside)


@nb.njit(cache=True, error_model="numpy")
def runs_of(walls, channel):
    """Return where the entries of a channel come from."""
    return Runs(walls.runs[channel], walls.counts[channel])


@nb.njit(cache=True, error_model="numpy")
def keep_sides(sides, kept, looks, n, orders, around, out):
    """Bring the sides of a patch to the ``n`` entries kept for a cell with walls ``around``; count them."""
    for channel in range(around.shape[0]):
        if around[channel]:
            keep_same(sides.signed, channel, kept, looks, orders, out.signed)
            keep_same(sides.inside, channel, kept, looks, orders, out.inside)
    count_sides(out.signed, n, around, out.below, out.above)


@nb.njit(cache=True, error_model="numpy")
def keep_walls(walls, patch, window, box, reach2, orders, returning, around, out):
    """Keep of the walls ``around`` a cell what lies within its reach; zero reactions if ``returning``."""
    channels = around.shape[0]
    for channel in range(channels):
        out.entries[channel] = 0
        if not around[channel]:
            continue
        kept = out.kept[channel]
        n, looks = keep_nearby(
            walls.rows[channel],
            ELEMENT_ROWS,
            walls.begin[channel],
            patch,
            window,
            box,
            reach2,
            orders,
            out.rows[channel],
            kept,
        )
        out.entries[channel], out.looks[channel] = n, looks
        if returning:
            out.reaction[channel, :, :n] = 0.0
        for other in range(channels):
            out.below[channel, other] = out.above[channel, other] = 0
        if n == 0 or not _others(around, channel):
            continue
        signed, inside = out.signed[channel], out.inside[channel]
        for other in range(channels):
            if around[other]:
                keep_same(walls.signed[channel], other, kept, looks, orders, signed)
                keep_same(walls.inside[channel], other, kept, looks, orders, inside)
        count_sides(signed, n, around, out.below[channel], out.above[channel])


@nb.njit(cache=True, error_model="numpy")
def add_reactions(nearby, around, walls):
    """Add what the particles of a cell returned to the walls to the buffers of the patch."""
    for channel in range(around.shape[0]):
        if around[channel] and nearby.entries[channel] > 0:
            add_back(
                nearby.reaction[channel], nearby.kept[channel], nearby.looks[channel], walls.reaction[channel]
            )


@nb.njit(cache=True, error_model="numpy")
def return_reactions(walls, around, panels, patch, mass, out):
    """Add the buffered reactions of a patch to its elements; those on images are mirrored back."""
    for channel in range(around.shape[0]):
        if not around[channel]:
            continue
        buf, begin, runs = walls.reaction[channel], walls.begin[channel], runs_of(walls, channel)
        for slab in range(slabs_and_rows(patch)[0]):
            m, rows = piece(begin, patch, slab, 0)[0], runs.rows[slab]
            for run in range(runs.count[slab]):
                first, length = rows[run, FIRST], rows[run, LAST] - rows[run, FIRST]
                for q in range(REACTION_SIZE):
                    factor = -mass if q == 1 and channel >= panels else mass
                    source, target = buf[q][m : m + length], out[q][first : first + length]
                    for j in range(length):
                        target[j] += factor * source[j]
                m += length


@nb.njit(cache=True, error_model="numpy")
def _others(around, channel):
    """Return whether any other wall than that of a channel is around."""
    for other in range(around.shape[0]):  # noqa: SIM110 - no generators in compiled code
        if around[other] and other != channel:
            return True
    return False
