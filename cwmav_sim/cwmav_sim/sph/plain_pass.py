# SPDX-License-Identifier: Apache-2.0
"""The passes over air and wall particles of the plain kind (see ``dynamic``): rates of both, and forces."""

from __future__ import annotations

import numba as nb

from cwmav_sim.sph.forces import (
    FLUID,
    FOUR_NU,
    MASS,
    RHO0,
    SLOPE,
    read_particle,
    store_rates,
)
from cwmav_sim.sph.gather import (
    ANY_IMAGE,
    aligned_rows,
    fill,
    slab_space,
    stretch,
    stretches,
    window,
)
from cwmav_sim.sph.pair import FLUID_ROWS, HALF_OVER_H, VOLUME, sum_pairs
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode
from cwmav_sim.sph.visibility import CHUNKS


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
    acceleration,
    density_rate,
    shift,
):
    """Rates of change of the air among itself and the wall particles.

    Parameters
    ----------
    fluid, column, order, start : ndarray
        Packed air in cell order, columns, numbers, first places; likewise the wall particles.
    integers, cell, k, scale, shifting, acceleration, density_rate, shift
        As in :func:`cwmav_sim.sph.forces.fluid_pass`.
    keep_diffusion : bool
        False switches the density diffusion off for air that sees a wall particle.
    room, wall_room : int
        Lengths of the largest buffers.
    """
    ny, nx = integers[1], integers[0]
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        buf = aligned_rows(FLUID_ROWS, room, fluid)
        near = aligned_rows(FLUID_ROWS, wall_room, fluid)
        begin, runs = slab_space()
        wall_begin, _ = slab_space()
        for number in range(chunk, stretches(integers), CHUNKS):
            place = stretch(integers, number)
            cx, cy, z0, z1, centre = place
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, place, runs, buf, begin)
            solid = (wall, wall_column, wall_start)
            fill(solid, FLUID, ANY_IMAGE, integers, cell, place, runs, near, wall_begin)
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                first, n = window(begin, cz - z0)
                first_wall, n_wall = window(wall_begin, cz - z0)
                offset = cell.dtype.type(cz - centre) * cell[2]
                for i in range(start[c], start[c + 1]):
                    a, at = read_particle(fluid, offset, i), order[i]
                    sums = _sums(a, buf, first, n, k, shifting)
                    sees = _sees(a, near, first_wall, n_wall, k[HALF_OVER_H])
                    keep = keep_diffusion or not sees
                    store_rates(sums, scale, a[6], keep, at, acceleration, density_rate, shift)
                    if sees:
                        sums = _sums(a, near, first_wall, n_wall, k, shifting)
                        _add(sums, scale, a[6], at, acceleration, density_rate, shift)
        restore_mode(mode)


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def _sums(a, buf, first, n, k, shifting):
    """Return the sums over all of a buffer; walls of particles hide nothing.

    One function that both passes call: inlined into them, its sums have other last digits
    (docs/decisions/0013).
    """
    return sum_pairs(a, buf, buf[VOLUME], first, n, k, shifting)


@nb.njit(cache=True, error_model="numpy")
def _sees(a, buf, first, n, half_over_h):
    for j in range(first, first + n):
        dx, dy, dz = a[0] - buf[0, j], a[1] - buf[1, j], a[2] - buf[2, j]
        if (dx * dx + dy * dy + dz * dz) * half_over_h * half_over_h < 1.0:
            return True
    return False


@nb.njit(cache=True, error_model="numpy")
def _add(sums, scale, density, place, acceleration, density_rate, shift):
    rho = scale[RHO0] + density
    slope = scale[SLOPE]
    for q in range(3):
        acceleration[place, q] += slope * (-sums[2 + q] / rho + scale[FOUR_NU] * sums[5 + q])
        shift[place, q] += slope * sums[8 + q]
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
    density_rate,
    force,
):
    """Density rates of the wall particles, and the force of the air on each of them.

    Parameters
    ----------
    fluid, column, order, start, wall, wall_column, wall_order, wall_start, integers, cell, k, scale, room
        As in :func:`air_pass`.
    density_rate : ndarray, shape (n,), float64
        Filled with rates [kg/(m3 s)], under the numbers of the wall particles.
    force : ndarray, shape (8, n), float64
        Filled likewise with pressure force, viscous force [N], and the power of each on the moving wall [W].
    """
    ny, nx = integers[1], integers[0]
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        buf = aligned_rows(FLUID_ROWS, room, fluid)
        begin, runs = slab_space()
        for number in range(chunk, stretches(integers), CHUNKS):
            place = stretch(integers, number)
            cx, cy, z0, z1, centre = place
            empty = True
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                empty = empty and wall_start[c + 1] == wall_start[c]
            if empty:
                continue
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, place, runs, buf, begin)
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                first, n = window(begin, cz - z0)
                offset = cell.dtype.type(cz - centre) * cell[2]
                for i in range(wall_start[c], wall_start[c + 1]):
                    a, at = read_particle(wall, offset, i), wall_order[i]
                    sums = _sums(a, buf, first, n, k, False)
                    rho = scale[RHO0] + a[6]
                    density_rate[at] = scale[SLOPE] * rho * sums[0]
                    force[6, at] = force[7, at] = 0.0
                    for q in range(3):
                        force[q, at] = -scale[MASS] * scale[SLOPE] * sums[2 + q] / rho
                        force[3 + q, at] = scale[MASS] * scale[SLOPE] * scale[FOUR_NU] * sums[5 + q]
                        force[6, at] += force[q, at] * a[3 + q]
                        force[7, at] += force[3 + q, at] * a[3 + q]
        restore_mode(mode)
