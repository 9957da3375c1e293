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

from cwmav_sim.sph.gather import MOST_RUNS, REACH, SIGN, gather_rows, neighbour_runs

# Rows of packed probes: position, normal, inward direction, distance inside the outline.
PROBE_VECTORS, PROBE_SCALARS = 3, 1
PROBE_ROWS = 10


@nb.njit(cache=True)
def mark_near(start, integers, near):
    """Mark the cells with points of any set ``start``, shape (p, cells + 1), within reach."""
    nx, ny, nz, mirrored, reach_y = integers[0], integers[1], integers[2], integers[3], integers[4]
    near[:] = False
    for p in range(start.shape[0]):
        for c in range(nx * ny * nz):
            if start[p, c + 1] == start[p, c]:
                continue
            cx, cy, cz = c % nx, (c // nx) % ny, c // (nx * ny)
            for dz in range(-REACH, REACH + 1):
                for dy in range(-reach_y, reach_y + 1):
                    ky = cy + dy
                    if mirrored:
                        ky = -1 - ky if ky < 0 else (2 * ny - 1 - ky if ky >= ny else ky)
                    else:
                        ky %= ny
                    row = (((cz + dz) % nz) * ny + ky) * nx
                    for dx in range(-REACH, REACH + 1):
                        near[row + (cx + dx) % nx] = True


@nb.njit(cache=True)
def select_image(runs, count, sign, chosen):
    """Copy the runs of one mirror sign and return how many."""
    kept = 0
    for i in range(count):
        if runs[i, SIGN] == sign:
            chosen[kept] = runs[i]
            kept += 1
    return kept


@nb.njit(cache=True, parallel=True, error_model="numpy")
def locate(
    points,
    column,
    start,
    own,
    probes,
    probe_column,
    probe_start,
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
        Panel the points lie on, or -1; its distance is left zero.
    probes, probe_column, probe_start : ndarray
        Packed probes (10 rows), their columns, first places per panel, shape (p, cells + 1).
    integers, cell : ndarray
        Grid integers and cell extent.
    near : ndarray, shape (cells,), bool
        Cells to look at.
    signed, inside : ndarray, shape (channels, n)
        Filled with s and d [m]; a zero s means far away. Channels beyond the panels are mirror images.
    normal : ndarray, shape (channels, 3, n)
        Filled with the normal at the nearest probe.
    """
    nx, ny, nz = integers[0], integers[1], integers[2]
    panels = probe_start.shape[0]
    channels = signed.shape[0]
    zero = cell.dtype.type(0.0)
    for row in nb.prange(ny * nz):
        runs = np.empty((MOST_RUNS, 6), np.int64)
        chosen = np.empty((MOST_RUNS, 6), np.int64)
        buf = np.empty((PROBE_ROWS, 1), cell.dtype)
        for cx in range(nx):
            c = row * nx + cx
            first, last = start[c], start[c + 1]
            if first == last:
                continue
            for channel in range(channels):
                for i in range(first, last):
                    signed[channel, i] = zero
                    inside[channel, i] = zero
            if not near[c]:
                continue
            for channel in range(channels):
                panel = channel % panels
                if channel == own:
                    continue
                count, points_around = neighbour_runs(
                    probe_start[panel], integers, cx, cx, row % ny, row // ny, runs
                )
                if points_around > buf.shape[1]:
                    buf = np.empty((PROBE_ROWS, 2 * points_around), cell.dtype)
                count = select_image(runs, count, 1 if channel < panels else -1, chosen)
                m = gather_rows(probes, probe_column, chosen, count, cell, PROBE_VECTORS, PROBE_SCALARS, buf)
                if m == 0:
                    continue
                for i in range(first, last):
                    x, y, z = points[0, i], points[1, i], points[2, i]
                    best = cell.dtype.type(1e30)
                    at = 0
                    for j in range(m):
                        dx, dy, dz = x - buf[0, j], y - buf[1, j], z - buf[2, j]
                        r2 = dx * dx + dy * dy + dz * dz
                        if r2 < best:
                            best = r2
                            at = j
                    dx, dy, dz = x - buf[0, at], y - buf[1, at], z - buf[2, at]
                    signed[channel, i] = dx * buf[3, at] + dy * buf[4, at] + dz * buf[5, at]
                    inside[channel, i] = buf[9, at] + dx * buf[6, at] + dy * buf[7, at] + dz * buf[8, at]
                    for q in range(3):
                        normal[channel, q, i] = buf[3 + q, at]


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def hide(weight, signed_a, inside_a, signed, inside, n, out):
    """Copy ``weight`` to ``out`` with zero where a wall stands between a particle and the entry.

    ``signed_a`` and ``inside_a`` are the distances of the particle, one per channel; ``signed`` and
    ``inside``, shape (channels, m), those of the entries.
    """
    zero = weight.dtype.type(0.0)
    for j in range(n):
        out[j] = weight[j]
    for c in range(signed.shape[0]):
        s_a, d_a = signed_a[c], inside_a[c]
        if s_a == zero:
            continue
        size = abs(s_a)
        s, d = signed[c], inside[c]
        for j in range(n):
            hidden = (s_a * s[j] < zero) & (d_a * abs(s[j]) + d[j] * size > zero)
            out[j] = zero if hidden else out[j]
