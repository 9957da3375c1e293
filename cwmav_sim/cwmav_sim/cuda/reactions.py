# SPDX-License-Identifier: Apache-2.0
"""The force of the air on every wall element, each gathered by a thread of its own from the particles around.

The terms are those of the wall pass with the opposite sign, so what the elements receive is what the
particles lose. An image of an element acts on a particle as the element acts on the image of the particle;
hence mirror images of particles count here too.
"""

from __future__ import annotations

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
from cwmav_sim.cuda.rows import REACH, extent, laps, layer, left_beyond, row, run
from cwmav_sim.cuda.vector import four, two
from cwmav_sim.cuda.visibility import hidden
from cwmav_sim.cuda.wall import wall_terms
from cwmav_sim.sph.wall import AREA, EVX, EVY, EVZ, EX, EY, EZ, NORMAL_ACCELERATION
from cwmav_sim.sph.wall import NX as NORMAL_X
from cwmav_sim.sph.wall import NY as NORMAL_Y
from cwmav_sim.sph.wall import NZ as NORMAL_Z


@cuda.jit(cache=True, fastmath=True)
def reaction_pass(
    elements,
    element_column,
    element_cell,
    of_panel,
    number,
    place,
    move,
    state,
    start,
    signed,
    inside,
    signed_e,
    inside_e,
    panels,
    integers,
    reach,
    k,
    mass,
    reaction,
):
    """Fill in the force [N] on every element and the air it carries along [kg], shape (4, m), by number."""
    e = cuda.grid(1)
    if e >= element_cell.shape[0]:
        return
    cx, cy, cz = place_of(element_cell[e], integers)
    nx, reach_y = integers[NX], integers[REACH_Y]
    one, zero = reach[ONE], reach[ZERO]
    x, y, z = elements[EX, e], elements[EY, e], elements[EZ, e]
    u, v, w = elements[EVX, e], elements[EVY, e], elements[EVZ, e]
    normal = (elements[NORMAL_X, e], elements[NORMAL_Y, e], elements[NORMAL_Z, e])
    panel = of_panel[e]
    fx = fy = fz = carried = zero
    shift_z = reach[MINUS_TWO]
    for dz in range(-REACH, REACH + 1):
        room_z = left_beyond(reach[SUPPORT2], reach, reach[CELL_Z], z, shift_z)
        first_row = layer(integers, cz, dz)
        shift_y = reach[MINUS_TWO] if reach_y > 0 else zero
        for dy in range(-reach_y, reach_y + 1):
            room = left_beyond(room_z, reach, reach[CELL_Y], y, shift_y)
            base, side = row(integers, first_row, cy, dy)
            sign = one if side > 0 else -one
            channel = panel if side > 0 else panel + panels
            if room > zero:
                low, high = extent(reach, x, room)
                first_lap, last_lap = laps(nx, cx + low, cx + high)
                own = element_column[e]
                column_e = own + reach[COLUMNS] if first_lap < 0 else own
                for lap in range(first_lap, last_lap + 1):
                    first, last = run(start, base, nx, cx + low, cx + high, lap)
                    for j in range(first, last):
                        xb, yb, zb, column_b = four(place, j)
                        ax = xb - x - (column_e - column_b) * reach[CELL_X]
                        ay = sign * yb - y + shift_y * reach[CELL_Y]
                        az = zb - z + shift_z * reach[CELL_Z]
                        r2 = ax * ax + ay * ay + az * az
                        if r2 >= reach[SUPPORT2]:
                            continue
                        if hidden(signed_e, inside_e, e, signed, inside, j, side < 0, panels):
                            continue
                        ub, vb, wb, _ = four(move, j)
                        density, pressure = two(state, j)
                        du, dv, dw = ub - u, sign * vb - v, wb - w
                        force, drag, ex, ey, ez, _, _, along = wall_terms(
                            (ax, ay, az, r2),
                            du,
                            dv,
                            dw,
                            normal,
                            elements[NORMAL_ACCELERATION, e],
                            elements[AREA, e],
                            signed[channel, j],
                            density,
                            pressure,
                            k,
                        )
                        fx -= force * ex + drag * du
                        fy -= force * ey + drag * dv
                        fz -= force * ez + drag * dw
                        carried -= along
                    column_e -= reach[COLUMNS]
            shift_y += one
        shift_z += one
    at = number[e]
    reaction[0, at] = mass * fx
    reaction[1, at] = mass * fy
    reaction[2, at] = mass * fz
    reaction[3, at] = mass * carried
