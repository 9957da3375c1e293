# SPDX-License-Identifier: Apache-2.0
"""The pass over all particles among thin walls: sums of fluid and walls, and the force on the walls.

As ``forces.fluid_pass``, with the wall elements and everybody's distances from the walls beside the
neighbours wherever there are walls around (see ``around``).
"""

from __future__ import annotations

import numba as nb
import numpy as np

from cwmav_sim.sph.around import (
    add_reactions,
    gather_walls,
    keep_sides,
    keep_walls,
    return_reactions,
    side_space,
    wall_space,
)
from cwmav_sim.sph.forces import (
    FLUID,
    LOAD_SIZE,
    MASS,
    RHO0,
    own_factors,
    read_particle,
    store_rates,
    support2,
)
from cwmav_sim.sph.gather import ANY_IMAGE, aligned_rows, fill
from cwmav_sim.sph.lending import held, lent
from cwmav_sim.sph.nearby import box_around, keep_nearby, space
from cwmav_sim.sph.pair import FLUID_ROWS, VOLUME, WORK_ROWS, sum_pairs
from cwmav_sim.sph.patches import CHUNKS, cell_of, cells_in, centre_of, dealt, marked_slabs, patch_of, share
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode
from cwmav_sim.sph.visibility import gather_sides, hide
from cwmav_sim.sph.wall import AREA, sum_wall


@nb.njit(cache=True, error_model="numpy")
def _add_wall(sums, scale, density, at, place, shifting, rates, load):
    """Add the wall sums of a particle to its rates and take the opposite force, at its place, to the wall."""
    acceleration, density_rate, shift = rates
    for q in range(3):
        acceleration[place, q] += sums[q] + sums[3 + q]
        if shifting:
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
    orders,
    signed,
    inside,
    near,
    near_any,
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
    near, near_any : ndarray, shape (channels, cells) and (cells,), bool
        Cells that have elements of a wall around them, and of any wall.
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
    channels, panels = signed.shape[0], element_start.shape[0]
    returning = reactions is not None
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        reach2 = support2(k)
        own_space = (
            space(FLUID_ROWS, WORK_ROWS + 1, room, fluid),
            (side_space(channels, room, fluid), side_space(channels, room, fluid)),
            (wall_space(channels, element_room, fluid), wall_space(channels, element_room, fluid)),
            aligned_rows(1, element_room, fluid),
            (np.zeros(LOAD_SIZE), np.zeros(channels, np.bool_)),
        )
        flow, (sides, nearby_sides), (walls, nearby_walls), area, (load, around) = lent(own_space)
        buf, begin, runs, nearby, kept, work = flow
        weight = work[WORK_ROWS]
        signed_a, inside_a, near_of, own_loads = lent((signed, inside, near, loads[chunk]))
        packed, beside = (elements, element_column, element_start), (element_signed, element_inside)
        for turn in range(share(integers)):
            number = dealt(integers, chunk, turn)
            if number < 0:
                continue
            patch = patch_of(integers, number)
            centre = centre_of(patch)
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, patch, runs, buf, begin)
            slabs = marked_slabs(near_any, integers, patch)
            close = slabs[1] > slabs[0]
            if close:
                gather_walls(packed, beside, near_of, slabs, integers, cell, patch, returning, around, walls)
                gather_sides(
                    signed, inside, begin, patch, runs, slabs, panels, around, sides.signed, sides.inside
                )
            for member in range(cells_in(patch)):
                c, window, offset = cell_of(patch, member, integers, cell)
                if start[c + 1] == start[c]:
                    continue
                box = box_around(fluid, start[c], start[c + 1], offset)
                n, looks = keep_nearby(
                    buf, FLUID_ROWS, begin, patch, window, box, reach2, orders, nearby, kept
                )
                beside_walls = near_any[c]
                if beside_walls:
                    keep_sides(sides, kept, looks, n, orders, near_of[:, c], nearby_sides)
                    keep_walls(
                        walls, patch, window, box, reach2, orders, returning, near_of[:, c], nearby_walls
                    )
                for i in range(start[c], start[c + 1]):
                    a = read_particle(fluid, offset, i)
                    s_a, d_a = signed_a[:, i], inside_a[:, i]
                    seen = nearby[VOLUME]
                    if beside_walls:
                        near_s, near_d, below, above = nearby_sides
                        seen = hide(seen, s_a, d_a, near_s, near_d, below, above, n, weight)
                    number_a = order[i]
                    own = own_factors(scale, a[6], keep_diffusion or not beside_walls, k)
                    sums = sum_pairs(a, own, nearby, seen, n, k, shifting, work)
                    store_rates(sums, scale, a[6], number_a, acceleration, density_rate, shift)
                    if not beside_walls:
                        continue
                    at = (
                        corner[0] + (patch.x + 0.5) * cell[0] + a[0],
                        corner[1] + (centre[0] + 0.5) * cell[1] + a[1],
                        corner[2] + (centre[1] + 0.5) * cell[2] + a[2],
                    )
                    for channel in range(channels):
                        n_wall = nearby_walls.entries[channel]
                        if n_wall == 0:
                            continue
                        rows = nearby_walls.rows[channel]
                        faced = hide(
                            rows[AREA],
                            s_a,
                            d_a,
                            nearby_walls.signed[channel],
                            nearby_walls.inside[channel],
                            nearby_walls.below[channel],
                            nearby_walls.above[channel],
                            n_wall,
                            area[0],
                        )
                        if reactions is None:
                            sums_wall = sum_wall(a, s_a[channel], rows, faced, n_wall, wall_k, None)
                        else:
                            returned = nearby_walls.reaction[channel]
                            sums_wall = sum_wall(a, s_a[channel], rows, faced, n_wall, wall_k, returned)
                        load[:] = 0.0
                        rates = acceleration, density_rate, shift
                        _add_wall(sums_wall, scale, a[6], at, number_a, shifting, rates, load)
                        if channel >= panels:  # the load on an image is the mirror of one on the wall itself
                            for q in (1, 4, 8, 10):
                                load[q] = -load[q]
                        for q in range(LOAD_SIZE):
                            own_loads[channel % panels, q] += load[q]
                if beside_walls and reactions is not None:
                    add_reactions(nearby_walls, around, walls)
            if close and reactions is not None:
                return_reactions(walls, around, panels, patch, scale[MASS], reactions[chunk])
        held(own_space)
        restore_mode(mode)
