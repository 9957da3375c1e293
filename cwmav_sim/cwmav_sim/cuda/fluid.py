# SPDX-License-Identifier: Apache-2.0
"""The fluid sums of all particles: one thread each, over neighbours in cell order.

Neighbours are taken row by row (see ``rows``). A row is looked through in pieces: first the places within the
support are marked in the bits of an integer, then only these are summed. Threads of a warp work on particles
of the same row, so they want the same memory and about the same number of pairs. The innermost loops load
whole records (see ``vector``) and count in unsigned integers of 32 bits, which spares them the arithmetic for
negative and for long indices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from cwmav_sim.cuda.cells import (
    CELL_X,
    CELL_Y,
    CELL_Z,
    COLUMNS,
    MINUS_TWO,
    NX,
    ONE,
    REACH_Y,
    SUPPORT2,
    ZERO,
    place_of,
)
from cwmav_sim.cuda.pair import add_pair, no_sums
from cwmav_sim.cuda.rows import REACH, extent, laps, layer, left_beyond, row, run
from cwmav_sim.cuda.vector import (
    COLUMN,
    DENSITY,
    MOVE_X,
    MOVE_Y,
    MOVE_Z,
    PLACE_X,
    PLACE_Y,
    PLACE_Z,
    PRESSURE,
    VOLUME,
    four,
    two,
)
from cwmav_sim.cuda.visibility import hidden
from cwmav_sim.sph.forces import DIFFUSION, FOUR_NU, RHO0, SLOPE

PIECE = 31  # places whose marks fit into a positive integer of 32 bits

# Places in the equation of state.
EOS_DENSITY, EOS_STIFFNESS, EOS_GAMMA, EOS_BACKGROUND = range(4)


@cuda.jit(cache=True)
def pack(x, v, rho, key, order, low, cell, integers, eos, mass, place, move, state, cell_of):
    """Put the particles into cell order, in the precision of the pairs.

    Parameters
    ----------
    x, v, rho : array, shape (3, n), (3, n) and (n,)
        Positions [m], velocities [m/s], densities [kg/m3].
    key, order : array, shape (n,), int32
        Cell of every particle, and the particle at every place.
    low, cell, integers : tuple
        Of the grid.
    eos : tuple of 4 float
        Density at rest, stiffness, exponent and background pressure.
    mass : float
        Mass of a particle [kg].
    place, move, state : array, shape (n, 4), (n, 4) and (n, 2)
        Filled with the records; positions are relative to the centre of the own cell, whose x index is the
        column.
    cell_of : array, shape (n,)
        Filled with the number of the cell at every place.
    """
    j = cuda.grid(1)
    if j < order.shape[0]:
        i = order[j]
        c = key[i]
        cx, cy, cz = place_of(c, integers)
        place[j, PLACE_X] = x[0, i] - low[0] - (cx + 0.5) * cell[0]
        place[j, PLACE_Y] = x[1, i] - low[1] - (cy + 0.5) * cell[1]
        place[j, PLACE_Z] = x[2, i] - low[2] - (cz + 0.5) * cell[2]
        place[j, COLUMN] = cx
        move[j, MOVE_X] = v[0, i]
        move[j, MOVE_Y] = v[1, i]
        move[j, MOVE_Z] = v[2, i]
        density = rho[i]
        ratio = density / eos[EOS_DENSITY]
        state[j, DENSITY] = density - eos[EOS_DENSITY]
        state[j, PRESSURE] = eos[EOS_STIFFNESS] * (ratio ** eos[EOS_GAMMA] - 1.0) + eos[EOS_BACKGROUND]
        move[j, VOLUME] = mass / density
        cell_of[j] = c


def _make_pass(hides: bool) -> Any:
    """Return the pass over particles that see no wall, or over those listed as near one."""

    @cuda.jit(device=True, fastmath=True)
    def sum_run(
        place, move, state, first, last, at, sign, a, sums, reach, k, shifting, signed, inside, panels, i
    ):
        """Add the places ``first`` .. ``last - 1`` to the sums of the particle at place ``i``.

        ``at`` is its position as seen from the row, and its column; ``sign`` is -1 in a mirror image.
        """
        xa, ya, za, column_a = at
        begin = np.uint32(first)
        while begin < last:
            end = np.uint32(min(begin + PIECE, last))
            marks = np.int32(0)
            bit = np.int32(1)
            j = begin
            while j < end:
                xb, yb, zb, column_b = four(place, j)
                dx = xa - xb + (column_a - column_b) * reach[CELL_X]
                dy = ya - sign * yb
                dz = za - zb
                if dx * dx + dy * dy + dz * dz < reach[SUPPORT2]:
                    marks = np.int32(marks | bit)
                bit = np.int32(bit << 1)
                j = np.uint32(j + 1)
            while marks != 0:
                j = np.uint32(begin + cuda.ffs(marks) - 1)
                marks = np.int32(marks & (marks - 1))
                xb, yb, zb, column_b = four(place, j)
                dx = xa - xb + (column_a - column_b) * reach[CELL_X]
                dy = ya - sign * yb
                dz = za - zb
                ub, vb, wb, volume = four(move, j)
                density, pressure = two(state, j)
                if hides and hidden(signed, inside, i, signed, inside, j, sign < reach[ZERO], panels):
                    volume = reach[ZERO]
                apart = (dx, dy, dz, dx * dx + dy * dy + dz * dz)
                b = (ub, sign * vb, wb, density, pressure, volume)
                sums = add_pair(sums, apart, a, b, k, shifting)
            begin = end
        return sums

    @cuda.jit(cache=True, fastmath=True)
    def fluid_pass(
        place,
        move,
        state,
        cell_of,
        start,
        order,
        near,
        listed,
        signed,
        inside,
        panels,
        integers,
        reach,
        k,
        scale,
        gravity,
        shifting,
        keep_diffusion,
        acceleration,
        density_rate,
        shift,
    ):
        t = cuda.grid(1)
        if t >= order.shape[0]:
            return
        i = t
        if hides:
            if t >= near[near.shape[0] - 1]:
                return
            i = listed[t]
        elif near[cell_of[i] + 1] > near[cell_of[i]]:
            return
        cx, cy, cz = place_of(cell_of[i], integers)
        nx, reach_y = integers[NX], integers[REACH_Y]
        x, y, z, column = four(place, i)
        ua, va, wa, _ = four(move, i)
        density, pressure = two(state, i)
        a = (ua, va, wa, density, pressure)
        one = reach[ONE]
        sums = no_sums(k)
        shift_z = reach[MINUS_TWO]
        dz = np.int32(-REACH)
        while dz <= REACH:
            room_z = left_beyond(reach[SUPPORT2], reach, reach[CELL_Z], z, shift_z)
            first_row = layer(integers, cz, dz)
            shift_y = reach[MINUS_TWO] if reach_y > 0 else reach[ZERO]
            dy = np.int32(-reach_y)
            while dy <= reach_y:
                room = left_beyond(room_z, reach, reach[CELL_Y], y, shift_y)
                if room > reach[ZERO]:
                    low, high = extent(reach, x, room)
                    base, side = row(integers, first_row, cy, dy)
                    sign = one if side > 0 else -one
                    lap, last_lap = laps(nx, cx + low, cx + high)
                    column_a = column + reach[COLUMNS] if lap < 0 else column
                    while lap <= last_lap:
                        first, last = run(start, base, nx, cx + low, cx + high, lap)
                        at = (x, y - shift_y * reach[CELL_Y], z - shift_z * reach[CELL_Z], column_a)
                        sums = sum_run(
                            place,
                            move,
                            state,
                            first,
                            last,
                            at,
                            sign,
                            a,
                            sums,
                            reach,
                            k,
                            shifting,
                            signed,
                            inside,
                            panels,
                            i,
                        )
                        column_a -= reach[COLUMNS]
                        lap = np.int32(lap + 1)
                shift_y += one
                dy = np.int32(dy + 1)
            shift_z += one
            dz = np.int32(dz + 1)
        number = order[i]
        rho = scale[RHO0] + density
        slope = scale[SLOPE]
        acceleration[0, number] = slope * (scale[FOUR_NU] * sums[5] - sums[2] / rho)
        acceleration[1, number] = slope * (scale[FOUR_NU] * sums[6] - sums[3] / rho)
        acceleration[2, number] = slope * (scale[FOUR_NU] * sums[7] - sums[4] / rho) + gravity
        diffusion = scale[DIFFUSION] if keep_diffusion or not hides else 0.0
        density_rate[number] = slope * (rho * sums[0] - diffusion * sums[1])
        if shifting:
            shift[0, number] = slope * sums[8]
            shift[1, number] = slope * sums[9]
            shift[2, number] = slope * sums[10]

    return fluid_pass


open_pass = _make_pass(hides=False)
near_pass = _make_pass(hides=True)
