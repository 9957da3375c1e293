# SPDX-License-Identifier: Apache-2.0
"""Which particles see each other past the thin walls.

Every point near a wall carries, for each wall, its signed distance s from the surface (extended beyond the
edge along the tangent) and its distance d inside the outline (negative outside). A straight line from a to
b crosses the surface where s vanishes; d interpolated linearly to that place decides whether the crossing
lies inside the outline:

    hidden  if  s_a s_b < 0  and  d_a |s_b| + d_b |s_a| > 0.

This needs neither a division nor a branch, is exact for a flat wall with straight edges and symmetric in a
and b, so no momentum is lost. Both distances come from the nearest of a set of probes on the surface, each
with its normal and the in-plane direction towards the inside.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from cwmav_sim.sph.blocks import BLOCK, long_vectors, scaled_block
from cwmav_sim.sph.cells import REACH
from cwmav_sim.sph.gather import FIRST, LAST, SIGN, aligned_rows, fill, piece, slab_space
from cwmav_sim.sph.lending import held, lent
from cwmav_sim.sph.patches import CHUNKS, cell_of, cells_in, dealt, patch_of, share

# Rows of packed probes: position, normal, inward direction, distance inside the outline.
PROBES = 3, 1  # vectors and scalars
PROBE_ROWS = 10


@nb.njit(cache=True)
def mark_near(start, integers, near):
    """Mark, channel by channel, the cells with points of a wall or of its mirror image within reach.

    Parameters
    ----------
    start : ndarray, shape (panels, cells + 1), int
        First place of every cell, panel by panel.
    integers : ndarray
        Grid integers.
    near : ndarray, shape (channels, cells), bool
        Filled; channels beyond the panels are mirror images.
    """
    nx, ny, nz, mirrored, reach_y = integers[0], integers[1], integers[2], integers[3], integers[4]
    panels = start.shape[0]
    near[:] = False
    for p in range(panels):
        for c in range(nx * ny * nz):
            if start[p, c + 1] == start[p, c]:
                continue
            cx, cy, cz = c % nx, (c // nx) % ny, c // (nx * ny)
            for dz in range(-REACH, REACH + 1):
                for dy in range(-reach_y, reach_y + 1):
                    ky, channel = cy + dy, p
                    if mirrored and (ky < 0 or ky >= ny):
                        ky, channel = (-1 - ky if ky < 0 else 2 * ny - 1 - ky), p + panels
                    row = (((cz + dz) % nz) * ny + ky % ny) * nx
                    for dx in range(-REACH, REACH + 1):
                        near[channel, row + (cx + dx) % nx] = True


@nb.njit(cache=True, error_model="numpy")
def clear(rows, first, last, chunk):
    """Set the part of a chunk of the columns from ``first`` to the one before ``last`` to zero."""
    begin = first + chunk * (last - first) // CHUNKS
    end = first + (chunk + 1) * (last - first) // CHUNKS
    for row in range(rows.shape[0]):
        rows[row, begin:end] = rows.dtype.type(0.0)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def locate(
    points,
    column,
    start,
    own,
    probes,
    probe_column,
    probe_start,
    room,
    integers,
    cell,
    near,
    signed,
    inside,
    normal,
):
    """Find the distances of sorted points from every wall.

    Parameters
    ----------
    points, column, start : ndarray
        Sorted points (at least three rows), x index of their cells, first place of every cell.
    own : int
        Panel the points lie on, or -1; its distance stays zero.
    probes, probe_column, probe_start : ndarray
        Packed probes (10 rows), their columns, first places per panel, shape (p, cells + 1).
    room : int
        Length of the largest buffer of probes.
    integers, cell : ndarray
        Grid integers and cell extent.
    near : ndarray, shape (channels, cells), bool
        Cells to look at.
    signed, inside : ndarray, shape (channels, n)
        Filled with s and d [m], zero far away. Channels beyond the panels are mirror images.
    normal : ndarray, shape (channels, 3, n)
        Filled with the normal at the nearest probe, but not far away.
    """
    panels, channels = probe_start.shape[0], signed.shape[0]
    for chunk in nb.prange(CHUNKS):
        clear(signed, start[0], start[-1], chunk)
        clear(inside, start[0], start[-1], chunk)
    for chunk in nb.prange(CHUNKS):
        own_space = slab_space(), aligned_rows(PROBE_ROWS, room, cell)
        (begin, runs), buf = lent(own_space)
        for turn in range(share(integers)):
            number = dealt(integers, chunk, turn)
            if number < 0:
                continue
            patch = patch_of(integers, number)
            for channel in range(channels):
                panel = channel % panels
                if channel == own or not _any_inside(start, near[channel], integers, patch):
                    continue
                image = 1 if channel < panels else -1
                wall = (probes, probe_column, probe_start[panel])
                fill(wall, PROBES, image, integers, cell, patch, runs, buf, begin)
                for member in range(cells_in(patch)):
                    c, window, offset = cell_of(patch, member, integers, cell)
                    if not near[channel, c]:
                        continue
                    for i in range(start[c], start[c + 1]):
                        x, y, z = points[0, i], points[1, i] + offset[0], points[2, i] + offset[1]
                        at = _nearest(x, y, z, buf, begin, patch, window)
                        if at >= 0:
                            _measure(x, y, z, buf, at, channel, i, signed, inside, normal)
        held(own_space)


@nb.njit(cache=True, error_model="numpy")
def _any_inside(start, near, integers, patch):
    """Return whether any of the marked cells of a patch holds a point."""
    for z in range(patch.z0, patch.z1):
        for y in range(patch.y0, patch.y1):
            c = (z * integers[1] + y) * integers[0] + patch.x
            if near[c] and start[c + 1] > start[c]:
                return True
    return False


@nb.njit(cache=True, error_model="numpy")
def _nearest(x, y, z, buf, begin, patch, window):
    """Return the nearest of the probes around a cell, or -1 where there is none."""
    best, at = buf.dtype.type(np.inf), -1
    for slab in range(window[0], window[0] + 2 * REACH + 1):
        first, last = piece(begin, patch, slab, window[1])
        for j in range(first, last):
            dx, dy, dz = x - buf[0, j], y - buf[1, j], z - buf[2, j]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < best:
                best = r2
                at = j
    return at


@nb.njit(cache=True, error_model="numpy")
def _measure(x, y, z, buf, at, channel, i, signed, inside, normal):
    """Distances of one point by the probe ``at``."""
    dx, dy, dz = x - buf[0, at], y - buf[1, at], z - buf[2, at]
    signed[channel, i] = dx * buf[3, at] + dy * buf[4, at] + dz * buf[5, at]
    inside[channel, i] = buf[9, at] + dx * buf[6, at] + dy * buf[7, at] + dz * buf[8, at]
    for q in range(3):
        normal[channel, q, i] = buf[3 + q, at]


@nb.njit(cache=True, error_model="numpy")
def gather_sides(signed, inside, begin, patch, runs, slabs, panels, wanted, signed_out, inside_out):
    """Copy the wall distances of what :func:`~cwmav_sim.sph.gather.fill` copied.

    Only ``slabs`` from the first to the one before the last are copied, and of the channels those that are
    ``wanted``, shape (channels,). In a mirror a wall and its image swap places.
    """
    channels = signed.shape[0]
    one, zero = signed_out.dtype.type(1.0), signed_out.dtype.type(0.0)
    for slab in range(slabs[0], slabs[1]):
        m, rows = piece(begin, patch, slab, 0)[0], runs.rows[slab]
        for run in range(runs.count[slab]):
            first, length = rows[run, FIRST], rows[run, LAST] - rows[run, FIRST]
            blocks = min((length + BLOCK - 1) // BLOCK, (signed.shape[1] - first) // BLOCK)
            for c in range(channels):
                if not wanted[c]:
                    continue
                source = c if rows[run, SIGN] > 0 else (c + panels) % channels
                for block in range(blocks):
                    at, of = m + block * BLOCK, first + block * BLOCK
                    scaled_block(signed_out, c, at, signed, source, of, one, zero)
                    scaled_block(inside_out, c, at, inside, source, of, one, zero)
                for j in range(blocks * BLOCK, length):
                    signed_out[c, m + j] = signed[source, first + j]
                    inside_out[c, m + j] = inside[source, first + j]
            m += length


@nb.njit(cache=True, error_model="numpy")
def count_sides(signed, n, wanted, below, above):
    """Count how many of the first ``n`` entries of a buffer lie on either side of every wall.

    Parameters
    ----------
    signed : ndarray, shape (channels, room)
        Distances of the entries from the walls; zero behind the last one.
    wanted : ndarray, shape (channels,), bool
        Channels to count.
    below, above : ndarray, shape (channels,), int32
        Filled: entries with a negative and with a positive distance.
    """
    long_vectors()
    for c in range(signed.shape[0]):
        if not wanted[c]:
            continue
        s = signed[c][:n]
        negative = positive = np.int32(0)
        for j in range(n):  # sums of integers, which become vector loops; a minimum does not
            negative += np.int32(s[j] < 0)
            positive += np.int32(s[j] > 0)
        below[c], above[c] = negative, positive


@nb.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
def hide(weight, signed_a, inside_a, signed, inside, below, above, n, out):
    """Return ``weight`` with zero where a wall stands between a particle and an entry.

    Parameters
    ----------
    weight : ndarray, shape (m,)
        One value per entry; returned as it is when no wall can be in between.
    signed_a, inside_a : ndarray, shape (channels,)
        Distances of the particle; zero for every wall out of its reach, whose channels are not looked at.
    signed, inside : ndarray, shape (channels, m)
        Distances of the entries.
    below, above : ndarray, shape (channels,), int32
        From :func:`count_sides`.
    n : int
        Entries in use.
    out : ndarray, shape (m,)
        Room for the result; not ``weight``.
    """
    long_vectors()
    zero = weight.dtype.type(0.0)
    copied = False
    for c in range(signed.shape[0]):
        s_a, d_a = signed_a[c], inside_a[c]
        if s_a == zero or (above[c] if s_a < zero else below[c]) == 0:
            continue
        size = abs(s_a)
        s, d, target = signed[c][:n], inside[c][:n], out[:n]
        # Two loops, because source and target of one must not be the same memory if it is to use vectors.
        if not copied:
            copied = True
            source = weight[:n]
            for j in range(n):
                hidden = (s_a * s[j] < zero) & (d_a * abs(s[j]) + d[j] * size > zero)
                target[j] = zero if hidden else source[j]
        else:
            for j in range(n):
                hidden = (s_a * s[j] < zero) & (d_a * abs(s[j]) + d[j] * size > zero)
                target[j] = zero if hidden else target[j]
    return out if copied else weight
