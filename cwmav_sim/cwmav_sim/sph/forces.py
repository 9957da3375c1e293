# SPDX-License-Identifier: Apache-2.0
"""One pass over all particles: fluid sums, wall sums, rates of change, and the force on the walls.

Work is done group by group of cells (see ``gather``). Groups are dealt to a fixed number of chunks, each of
which adds up its own wall forces, so results do not depend on how many threads there are or on their order.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from cwmav_sim.sph import wall
from cwmav_sim.sph.gather import FAR, MOST_RUNS, gather_rows, neighbour_runs, pad
from cwmav_sim.sph.pair import FLUID_ROWS, VOLUME, sum_pairs
from cwmav_sim.sph.visibility import hide, select_image
from cwmav_sim.sph.wall import AREA, ELEMENT_ROWS, ELEMENT_SCALARS, ELEMENT_VECTORS, sum_wall

GROUP = 3  # cells per buffer
CHUNKS = 64  # independent parts of a pass

# Places in the array of scale factors.
SLOPE, FOUR_NU, DIFFUSION, RHO0, MASS = range(5)

# Places in a wall load: pressure force, viscous force, power of the two on the moving wall.
LOAD_SIZE = 8


@nb.njit(cache=True, error_model="numpy")
def gather_sides(sides, runs, count, panels, buf):
    """Copy wall distances of the runs, shape (channels, n); in a mirror a wall and its image swap places."""
    channels = sides.shape[0]
    m = 0
    for run in range(count):
        first, last = runs[run, 0], runs[run, 1]
        for c in range(channels):
            source = c if runs[run, 5] > 0 else (c + panels) % channels
            for j in range(last - first):
                buf[c, m + j] = sides[source, first + j]
        m += last - first
    for c in range(channels):
        for j in range(m, buf.shape[1]):
            buf[c, j] = buf.dtype.type(0.0)


@nb.njit(cache=True, error_model="numpy")
def _particle(fluid, column, cx, cell, i):
    """Values of one particle with its position relative to the centre of cell ``cx``."""
    x = fluid[0, i] + (column[i] - column.dtype.type(cx)) * cell[0]
    return (x, fluid[1, i], fluid[2, i], fluid[3, i], fluid[4, i], fluid[5, i], fluid[6, i], fluid[7, i])


@nb.njit(cache=True, error_model="numpy")
def _store(sums, scale, density, keep_diffusion, i, rates, shift):
    """Turn the fluid sums of a particle into rates of change (float64)."""
    rho = scale[RHO0] + density
    slope = scale[SLOPE]
    for q in range(3):
        rates[q, i] = slope * (-sums[2 + q] / rho + scale[FOUR_NU] * sums[5 + q])
        shift[q, i] = slope * sums[8 + q]
    rates[3, i] = slope * (rho * sums[0] - (scale[DIFFUSION] * sums[1] if keep_diffusion else 0.0))


@nb.njit(cache=True, error_model="numpy")
def _add_wall(sums, scale, density, i, rates, shift, load):
    """Add the wall sums of a particle to its rates and take the opposite force to the wall."""
    for q in range(3):
        rates[q, i] += sums[q] + sums[3 + q]
        shift[q, i] += sums[7 + q]
        load[q] -= scale[MASS] * sums[q]
        load[3 + q] -= scale[MASS] * sums[3 + q]
    load[6] -= scale[MASS] * sums[10]
    load[7] -= scale[MASS] * sums[11]
    rates[3, i] += (scale[RHO0] + density) * sums[6]


@nb.njit(cache=True, parallel=True, error_model="numpy")
def fluid_pass(fluid, column, start, integers, cell, k, scale, shifting, room, rates, shift):
    """Rates of change of particles that see no wall anywhere.

    Parameters
    ----------
    fluid : ndarray, shape (9, n)
        Packed particles in cell order.
    column, start, integers, cell : ndarray
        Their columns, first places, grid integers and cell extent.
    k, scale : ndarray
        Pair constants and scale factors.
    shifting : bool
        Whether the shifting vector is wanted.
    room : int
        Length of the largest buffer.
    rates, shift : ndarray, shape (4, n) and (3, n), float64
        Filled with acceleration and density rate, and with the shifting vector [1/m], in cell order.
    """
    nx, ny, nz = integers[0], integers[1], integers[2]
    for chunk in nb.prange(CHUNKS):
        buf = np.empty((FLUID_ROWS, room), fluid.dtype)
        runs = np.empty((MOST_RUNS, 6), np.int64)
        filler = np.zeros(FLUID_ROWS, fluid.dtype)
        filler[0] = FAR
        for row in range(chunk, ny * nz, CHUNKS):
            for cx in range(0, nx, GROUP):
                cx1 = min(cx + GROUP, nx) - 1
                first, last = start[row * nx + cx], start[row * nx + cx1 + 1]
                if first == last:
                    continue
                count, _ = neighbour_runs(start, integers, cx, cx1, row % ny, row // ny, runs)
                m = pad(buf, gather_rows(fluid, column, runs, count, cell, 2, 3, buf), filler)
                for i in range(first, last):
                    a = _particle(fluid, column, cx, cell, i)
                    sums = sum_pairs(a, buf, buf[VOLUME], m, k, shifting)
                    _store(sums, scale, a[6], True, i, rates, shift)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def walled_pass(
    fluid,
    column,
    start,
    integers,
    cell,
    k,
    scale,
    shifting,
    keep_diffusion,
    room,
    signed,
    inside,
    near,
    elements,
    element_column,
    element_start,
    element_room,
    element_signed,
    element_inside,
    wall_k,
    rates,
    shift,
    loads,
):
    """Rates of change of particles among thin walls, and the forces on the walls.

    Parameters are those of :func:`fluid_pass` and, for the walls,

    keep_diffusion : bool
        False switches the density diffusion off for particles that see a wall.
    signed, inside : ndarray, shape (channels, n)
        Wall distances of the particles; channels beyond the panels are mirror images of the panels.
    near : ndarray, shape (cells,), bool
        Cells that have wall elements around them.
    elements, element_column, element_start, element_room : ndarray, int
        Packed elements sorted by panel and cell, columns, first places, shape (p, cells + 1), buffer length.
    element_signed, element_inside : ndarray, shape (channels, m)
        Distances of the elements from the other walls.
    wall_k : ndarray
        Wall constants.
    loads : ndarray, shape (chunks, panels, 8), float64
        Filled with the wall loads of every chunk.
    """
    nx, ny, nz = integers[0], integers[1], integers[2]
    channels, panels = signed.shape[0], element_start.shape[0]
    for chunk in nb.prange(CHUNKS):
        buf = np.empty((FLUID_ROWS, room), fluid.dtype)
        weight = np.empty(room, fluid.dtype)
        side_s = np.empty((channels, room), fluid.dtype)
        side_d = np.empty((channels, room), fluid.dtype)
        wall_buf = np.empty((channels, ELEMENT_ROWS, element_room), fluid.dtype)
        wall_s = np.empty((channels, channels, element_room), fluid.dtype)
        wall_d = np.empty((channels, channels, element_room), fluid.dtype)
        area = np.empty(element_room, fluid.dtype)
        used = np.zeros(channels, np.int64)
        runs = np.empty((MOST_RUNS, 6), np.int64)
        chosen = np.empty((MOST_RUNS, 6), np.int64)
        filler = np.zeros(FLUID_ROWS, fluid.dtype)
        filler[0] = FAR
        wall_filler = np.zeros(ELEMENT_ROWS, fluid.dtype)
        wall_filler[0] = FAR
        load = np.zeros(LOAD_SIZE)
        for row in range(chunk, ny * nz, CHUNKS):
            cy, cz = row % ny, row // ny
            for cx in range(0, nx, GROUP):
                cx1 = min(cx + GROUP, nx) - 1
                first, last = start[row * nx + cx], start[row * nx + cx1 + 1]
                if first == last:
                    continue
                count, _ = neighbour_runs(start, integers, cx, cx1, cy, cz, runs)
                m = pad(buf, gather_rows(fluid, column, runs, count, cell, 2, 3, buf), filler)
                close = False
                for c in range(cx, cx1 + 1):
                    close |= near[row * nx + c]
                if close:
                    gather_sides(signed, runs, count, panels, side_s)
                    gather_sides(inside, runs, count, panels, side_d)
                    for channel in range(channels):
                        count, _ = neighbour_runs(
                            element_start[channel % panels], integers, cx, cx1, cy, cz, runs
                        )
                        count = select_image(runs, count, 1 if channel < panels else -1, chosen)
                        n = gather_rows(
                            elements,
                            element_column,
                            chosen,
                            count,
                            cell,
                            ELEMENT_VECTORS,
                            ELEMENT_SCALARS,
                            wall_buf[channel],
                        )
                        used[channel] = pad(wall_buf[channel], n, wall_filler)
                        gather_sides(element_signed, chosen, count, panels, wall_s[channel])
                        gather_sides(element_inside, chosen, count, panels, wall_d[channel])
                for i in range(first, last):
                    a = _particle(fluid, column, cx, cell, i)
                    if not close:
                        sums = sum_pairs(a, buf, buf[VOLUME], m, k, shifting)
                        _store(sums, scale, a[6], True, i, rates, shift)
                        continue
                    hide(buf[VOLUME], signed[:, i], inside[:, i], side_s, side_d, m, weight)
                    sums = sum_pairs(a, buf, weight, m, k, shifting)
                    _store(sums, scale, a[6], keep_diffusion, i, rates, shift)
                    for channel in range(channels):
                        n = used[channel]
                        if n == 0:
                            continue
                        element = wall_buf[channel]
                        hide(
                            element[AREA],
                            signed[:, i],
                            inside[:, i],
                            wall_s[channel],
                            wall_d[channel],
                            n,
                            area,
                        )
                        sums_wall = sum_wall(a, signed[channel, i], element, area, n, wall_k)
                        load[:] = 0.0
                        _add_wall(sums_wall, scale, a[6], i, rates, shift, load)
                        if channel >= panels:  # the force on an image is the mirror of one on the wall itself
                            load[1] = -load[1]
                            load[4] = -load[4]
                        loads[chunk, channel % panels] += load


def wall_room(start: np.ndarray, integers: np.ndarray, largest) -> int:
    """Return the buffer length that holds the elements of any panel around any group."""
    return max([largest(row, integers, GROUP) for row in start], default=0)


__all__ = ["CHUNKS", "GROUP", "LOAD_SIZE", "fluid_pass", "wall", "wall_room", "walled_pass"]
