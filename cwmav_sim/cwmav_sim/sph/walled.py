# SPDX-License-Identifier: Apache-2.0
"""The pass over all particles among thin walls: sums of fluid and walls, and the force on the walls.

As ``forces.fluid_pass``, with the wall elements and everybody's distances from the walls buffered beside the
neighbours of a stretch that has walls around it.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from cwmav_sim.sph.forces import (
    FLUID,
    LOAD_SIZE,
    MASS,
    RHO0,
    read_particle,
    store_rates,
)
from cwmav_sim.sph.gather import (
    ANY_IMAGE,
    FIRST,
    LAST,
    PADDING,
    REACH,
    SLABS,
    aligned_rows,
    any_marked,
    fill,
    slab_runs,
    slab_space,
    stretch,
    stretches,
    window,
)
from cwmav_sim.sph.pair import FLUID_ROWS, VOLUME, sum_pairs
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode
from cwmav_sim.sph.visibility import CHUNKS, count_sides, gather_sides, hide
from cwmav_sim.sph.wall import AREA, ELEMENT_ROWS, ELEMENTS, sum_wall

REACTION_SIZE = 4  # force on an element, and the mass of air it carries along


@nb.njit(cache=True, error_model="numpy")
def _add_wall(sums, scale, density, at, place, acceleration, density_rate, shift, load):
    """Add the wall sums of a particle to its rates and take the opposite force, at its place, to the wall."""
    for q in range(3):
        acceleration[place, q] += sums[q] + sums[3 + q]
        shift[place, q] += sums[7 + q]
        load[q] -= scale[MASS] * sums[q]
        load[3 + q] -= scale[MASS] * sums[3 + q]
    load[6] -= scale[MASS] * sums[10]
    load[7] -= scale[MASS] * sums[11]
    x, y, z = at
    fx, fy, fz = load[0] + load[3], load[1] + load[4], load[2] + load[5]
    load[8] += y * fz - z * fy
    load[9] += z * fx - x * fz
    load[10] += x * fy - y * fx
    density_rate[place] += (scale[RHO0] + density) * sums[6]


@nb.njit(cache=True, error_model="numpy")
def _gather_element_sides(
    signed, inside, start, integers, place, image, panels, runs, around, begin, side_s, side_d, below, above
):
    """Copy and count where the buffered elements of one wall lie with respect to the walls around."""
    slabs = place[3] - place[2] + 2 * REACH
    gather_sides(signed, start, integers, place, image, panels, runs, around, side_s)
    count_sides(side_s, begin, slabs, around, below, above)
    for other in range(signed.shape[0]):
        if around[other] and (below[other, slabs] > 0 or above[other, slabs] > 0):
            gather_sides(inside, start, integers, place, image, panels, runs, around, side_d)
            return


@nb.njit(cache=True, error_model="numpy")
def _return_reactions(buf, begin, start, integers, place, image, mass, runs, out):
    """Add the buffered reactions of a stretch to their elements; those on images are mirrored back."""
    cx, cy, z0, z1, centre = place
    for slab in range(z1 - z0 + 2 * REACH):
        m = begin[slab]
        count = slab_runs(start, integers, cx, cy, centre, z0 - REACH + slab - centre, image, runs)
        for run in range(count):
            first, length = runs[run, FIRST], runs[run, LAST] - runs[run, FIRST]
            for q in range(REACTION_SIZE):
                factor = image * mass if q == 1 else mass
                source, target = buf[q][m : m + length], out[q][first : first + length]
                for j in range(length):
                    target[j] += factor * source[j]
            m += length


@nb.njit(cache=True, parallel=True, error_model="numpy")
def walled_pass(
    fluid,
    column,
    order,
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
    corner,
    acceleration,
    density_rate,
    shift,
    loads,
    reactions,
):
    """Rates of change of particles among thin walls, and the forces on the walls.

    Parameters are those of :func:`~cwmav_sim.sph.forces.fluid_pass` and, for the walls,

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
    corner : ndarray, shape (3,), float64
        Lower corner of the box.
    loads : ndarray, shape (chunks, panels, 11), float64
        Filled with the wall loads of every chunk.
    reactions : ndarray, shape (chunks, 4, m), float64, or None
        Receives the force on every element and the mass of air it carries along, chunk by chunk.
    """
    nx, ny = integers[0], integers[1]
    channels, panels = signed.shape[0], element_start.shape[0]
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        buf = aligned_rows(FLUID_ROWS, room, fluid)
        begin, runs = slab_space()
        weight = aligned_rows(1, room, fluid)[0]
        side_s = aligned_rows(channels, room, fluid)
        side_d = aligned_rows(channels, room, fluid)
        below, above = np.empty((channels, SLABS + 1), np.int32), np.empty((channels, SLABS + 1), np.int32)
        wall_buf = aligned_rows(channels * ELEMENT_ROWS, element_room, fluid).reshape(
            (channels, ELEMENT_ROWS, element_room)
        )
        wall_begin = np.empty((channels, SLABS + 1), np.int64)
        wall_s = aligned_rows(channels * channels, element_room, fluid).reshape(
            (channels, channels, element_room)
        )
        wall_d = aligned_rows(channels * channels, element_room, fluid).reshape(
            (channels, channels, element_room)
        )
        wall_below = np.empty((channels, channels, SLABS + 1), np.int32)
        wall_above = np.empty((channels, channels, SLABS + 1), np.int32)
        area = aligned_rows(1, element_room, fluid)[0]
        reaction = np.zeros((channels, REACTION_SIZE, element_room), fluid.dtype)
        load = np.zeros(LOAD_SIZE)
        around = np.zeros(channels, np.bool_)
        for number in range(chunk, stretches(integers), CHUNKS):
            place = stretch(integers, number)
            cx, cy, z0, z1, centre = place
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, place, runs, buf, begin)
            close = any_marked(near, integers, place)
            if close:
                slabs = z1 - z0 + 2 * REACH
                for channel in range(channels):
                    points = (elements, element_column, element_start[channel % panels])
                    image = 1 if channel < panels else -1
                    buffer, first_entry = wall_buf[channel], wall_begin[channel]
                    fill(points, ELEMENTS, image, integers, cell, place, runs, buffer, first_entry)
                    # A wall without elements around here is out of reach of every particle of the stretch.
                    around[channel] = wall_begin[channel, slabs] > 0
                gather_sides(signed, start, integers, place, ANY_IMAGE, panels, runs, around, side_s)
                gather_sides(inside, start, integers, place, ANY_IMAGE, panels, runs, around, side_d)
                count_sides(side_s, begin, slabs, around, below, above)
                for channel in range(channels):
                    if not around[channel]:
                        continue
                    if reactions is not None:
                        reaction[channel, :, : wall_begin[channel, slabs] + PADDING] = 0.0
                    _gather_element_sides(
                        element_signed,
                        element_inside,
                        element_start[channel % panels],
                        integers,
                        place,
                        1 if channel < panels else -1,
                        panels,
                        runs,
                        around,
                        wall_begin[channel],
                        wall_s[channel],
                        wall_d[channel],
                        wall_below[channel],
                        wall_above[channel],
                    )
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                if start[c + 1] == start[c]:
                    continue
                first, n = window(begin, cz - z0)
                offset = cell.dtype.type(cz - centre) * cell[2]
                if not near[c]:
                    for i in range(start[c], start[c + 1]):
                        a = read_particle(fluid, offset, i)
                        sums = sum_pairs(a, buf, buf[VOLUME], first, n, k, shifting)
                        store_rates(sums, scale, a[6], True, order[i], acceleration, density_rate, shift)
                    continue
                for i in range(start[c], start[c + 1]):
                    a = read_particle(fluid, offset, i)
                    s_a, d_a = signed[:, i], inside[:, i]
                    seen = hide(
                        buf[VOLUME], s_a, d_a, side_s, side_d, below, above, cz - z0, first, n, weight
                    )
                    sums = sum_pairs(a, buf, seen, first, n, k, shifting)
                    own = order[i]
                    store_rates(sums, scale, a[6], keep_diffusion, own, acceleration, density_rate, shift)
                    for channel in range(channels):
                        first_wall, n_wall = window(wall_begin[channel], cz - z0)
                        if n_wall == 0:
                            continue
                        element = wall_buf[channel]
                        faced = hide(
                            element[AREA],
                            s_a,
                            d_a,
                            wall_s[channel],
                            wall_d[channel],
                            wall_below[channel],
                            wall_above[channel],
                            cz - z0,
                            first_wall,
                            n_wall,
                            area,
                        )
                        if reactions is None:
                            sums_wall = sum_wall(
                                a, s_a[channel], element, faced, first_wall, n_wall, wall_k, None
                            )
                        else:
                            sums_wall = sum_wall(
                                a, s_a[channel], element, faced, first_wall, n_wall, wall_k, reaction[channel]
                            )
                        load[:] = 0.0
                        at = (
                            corner[0] + (cx + 0.5) * cell[0] + a[0],
                            corner[1] + (cy + 0.5) * cell[1] + a[1],
                            corner[2] + (centre + 0.5) * cell[2] + a[2],
                        )
                        _add_wall(sums_wall, scale, a[6], at, own, acceleration, density_rate, shift, load)
                        if channel >= panels:  # the load on an image is the mirror of one on the wall itself
                            for q in (1, 4, 8, 10):
                                load[q] = -load[q]
                        loads[chunk, channel % panels] += load
            if close and reactions is not None:
                for channel in range(channels):
                    _return_reactions(
                        reaction[channel],
                        wall_begin[channel],
                        element_start[channel % panels],
                        integers,
                        place,
                        1 if channel < panels else -1,
                        scale[MASS],
                        runs,
                        reactions[chunk],
                    )
        restore_mode(mode)
