# SPDX-License-Identifier: Apache-2.0
"""The passes over air and wall particles of the plain kind (see ``dynamic``): rates of both, and forces."""

from __future__ import annotations

import numba as nb

from cwmav_sim.sph.forces import (
    FLUID,
    MASS,
    RHO0,
    SLOPE,
    own_factors,
    read_particle,
    store_rates,
    support2,
)
from cwmav_sim.sph.gather import ANY_IMAGE, fill
from cwmav_sim.sph.lending import held, lent
from cwmav_sim.sph.nearby import box_around, keep_nearby, space
from cwmav_sim.sph.pair import FLUID_ROWS, HALF_OVER_H, VOLUME, WORK_ROWS, ZERO, sum_pairs
from cwmav_sim.sph.patches import CHUNKS, cell_of, cells_in, dealt, patch_of, share
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode


@nb.njit(cache=True, parallel=True, error_model="numpy")
def air_pass(
    fluid,
    column,
    order,
    start,
    wall,
    wall_column,
    wall_order,
    wall_start,
    integers,
    cell,
    k,
    scale,
    shifting,
    keep_diffusion,
    room,
    wall_room,
    orders,
    acceleration,
    density_rate,
    shift,
):
    """Rates of change of the air among itself and the wall particles.

    Parameters
    ----------
    fluid, column, order, start : ndarray
        Packed air in cell order, columns, numbers, first places; likewise the wall particles.
    integers, cell, k, scale, shifting, orders, acceleration, density_rate, shift
        As in :func:`cwmav_sim.sph.forces.fluid_pass`.
    keep_diffusion : bool
        False switches the density diffusion off for air that sees a wall particle.
    room, wall_room : int
        Lengths of the largest buffers.
    """
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        own_space = (
            space(FLUID_ROWS, WORK_ROWS, room, fluid),
            space(FLUID_ROWS, WORK_ROWS, wall_room, fluid),
        )
        (buf, begin, runs, nearby, kept, work), solid_around = lent(own_space)
        wall_buf, wall_begin, _, solid_nearby, solid_kept, solid_work = solid_around
        reach2 = support2(k)
        for turn in range(share(integers)):
            number = dealt(integers, chunk, turn)
            if number < 0:
                continue
            patch = patch_of(integers, number)
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, patch, runs, buf, begin)
            solid = (wall, wall_column, wall_start)
            fill(solid, FLUID, ANY_IMAGE, integers, cell, patch, runs, wall_buf, wall_begin)
            for member in range(cells_in(patch)):
                c, window, offset = cell_of(patch, member, integers, cell)
                if start[c + 1] == start[c]:
                    continue
                box = box_around(fluid, start[c], start[c + 1], offset)
                n, _ = keep_nearby(buf, FLUID_ROWS, begin, patch, window, box, reach2, orders, nearby, kept)
                n_wall, _ = keep_nearby(
                    wall_buf,
                    FLUID_ROWS,
                    wall_begin,
                    patch,
                    window,
                    box,
                    reach2,
                    orders,
                    solid_nearby,
                    solid_kept,
                )
                for i in range(start[c], start[c + 1]):
                    a, at = read_particle(fluid, offset, i), order[i]
                    sees = _sees(a, solid_nearby, n_wall, k[HALF_OVER_H])
                    own = own_factors(scale, a[6], keep_diffusion or not sees, k)
                    sums = _sums(a, own, nearby, n, k, shifting, work)
                    store_rates(sums, scale, a[6], at, acceleration, density_rate, shift)
                    if sees:
                        own = own_factors(scale, a[6], False, k)
                        sums = _sums(a, own, solid_nearby, n_wall, k, shifting, solid_work)
                        _add(sums, scale, a[6], at, acceleration, density_rate, shift)
        held(own_space)
        restore_mode(mode)


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def _sums(a, own, buf, n, k, shifting, work):
    """Return the sums over all of a buffer; walls of particles hide nothing.

    One function that both passes call: inlined into them, its sums have other last digits
    (docs/decisions/0013).
    """
    return sum_pairs(a, own, buf, buf[VOLUME], n, k, shifting, work)


@nb.njit(cache=True, error_model="numpy")
def _sees(a, buf, n, half_over_h):
    for j in range(n):
        dx, dy, dz = a[0] - buf[0, j], a[1] - buf[1, j], a[2] - buf[2, j]
        if (dx * dx + dy * dy + dz * dz) * half_over_h * half_over_h < 1.0:
            return True
    return False


@nb.njit(cache=True, error_model="numpy")
def _add(sums, scale, density, place, acceleration, density_rate, shift):
    rho = scale[RHO0] + density
    slope = scale[SLOPE]
    for q in range(3):
        acceleration[place, q] -= slope / rho * sums[1 + q]
        shift[place, q] += slope * sums[4 + q]
    density_rate[place] += slope * rho * sums[0]


@nb.njit(cache=True, parallel=True, error_model="numpy")
def wall_pass(
    fluid,
    column,
    order,
    start,
    wall,
    wall_column,
    wall_order,
    wall_start,
    integers,
    cell,
    k,
    scale,
    room,
    orders,
    density_rate,
    force,
):
    """Density rates of the wall particles, and the force of the air on each of them.

    Parameters
    ----------
    fluid, column, order, start, wall, wall_column, wall_order, wall_start
        As in :func:`air_pass`, and likewise
    integers, cell, k, scale, room, orders
        As in :func:`air_pass`.
    density_rate : ndarray, shape (n,), float64
        Filled with rates [kg/(m3 s)], under the numbers of the wall particles.
    force : ndarray, shape (8, n), float64
        Filled likewise with pressure force, viscous force [N], and the power of each on the moving wall [W].
    """
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        own_space = space(FLUID_ROWS, WORK_ROWS, room, fluid)
        buf, begin, runs, nearby, kept, work = lent(own_space)
        reach2 = support2(k)
        for turn in range(share(integers)):
            number = dealt(integers, chunk, turn)
            if number < 0:
                continue
            patch = patch_of(integers, number)
            empty = True
            for member in range(cells_in(patch)):
                c, _, _ = cell_of(patch, member, integers, cell)
                empty = empty and wall_start[c + 1] == wall_start[c]
            if empty:
                continue
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, patch, runs, buf, begin)
            for member in range(cells_in(patch)):
                c, window, offset = cell_of(patch, member, integers, cell)
                if wall_start[c + 1] == wall_start[c]:
                    continue
                box = box_around(wall, wall_start[c], wall_start[c + 1], offset)
                n, _ = keep_nearby(buf, FLUID_ROWS, begin, patch, window, box, reach2, orders, nearby, kept)
                for i in range(wall_start[c], wall_start[c + 1]):
                    a, at = read_particle(wall, offset, i), wall_order[i]
                    own = own_factors(scale, a[6], False, k)
                    inviscid = (own[0], k[ZERO])
                    pressure = _sums(a, inviscid, nearby, n, k, False, work)
                    both = _sums(a, own, nearby, n, k, False, work)
                    rho = scale[RHO0] + a[6]
                    density_rate[at] = scale[SLOPE] * rho * both[0]
                    force[6, at] = force[7, at] = 0.0
                    to_force = -scale[MASS] * scale[SLOPE] / rho
                    for q in range(3):
                        force[q, at] = to_force * pressure[1 + q]
                        force[3 + q, at] = to_force * (both[1 + q] - pressure[1 + q])
                        force[6, at] += force[q, at] * a[3 + q]
                        force[7, at] += force[3 + q, at] * a[3 + q]
        held(own_space)
        restore_mode(mode)
