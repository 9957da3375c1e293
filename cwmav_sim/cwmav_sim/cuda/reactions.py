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
from cwmav_sim.cuda.rows import REACH, extent, row, run
from cwmav_sim.cuda.visibility import hidden
from cwmav_sim.cuda.wall import wall_terms
from cwmav_sim.sph.pair import DENSITY, PRESSURE, VX, VY, VZ, X, Y, Z
from cwmav_sim.sph.wall import AREA, EVX, EVY, EVZ, EX, EY, EZ, NORMAL_ACCELERATION
from cwmav_sim.sph.wall import NX as NORMAL_X
from cwmav_sim.sph.wall import NY as NORMAL_Y
from cwmav_sim.sph.wall import NZ as NORMAL_Z


@cuda.jit(fastmath=True)
def reaction_pass(
    elements,
    element_column,
    element_cell,
    of_panel,
    number,
    fluid,
    column,
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
        shift_y = reach[MINUS_TWO] if reach_y > 0 else zero
        for dy in range(-reach_y, reach_y + 1):
            low, high = extent(reach, x, y, z, shift_y, shift_z)
            base, side = row(integers, cy, cz, dy, dz)
            sign = one if side > 0 else -one
            channel = panel if side > 0 else panel + panels
            if low <= high:
                column_e = element_column[e] + reach[COLUMNS]
                for lap in range(-1, 2):
                    first, last = run(start, base, nx, cx + low, cx + high, lap)
                    for j in range(first, last):
                        ax = fluid[X, j] - x - (column_e - column[j]) * reach[CELL_X]
                        ay = sign * fluid[Y, j] - y + shift_y * reach[CELL_Y]
                        az = fluid[Z, j] - z + shift_z * reach[CELL_Z]
                        r2 = ax * ax + ay * ay + az * az
                        if r2 >= reach[SUPPORT2]:
                            continue
                        if hidden(signed_e, inside_e, e, signed, inside, j, side < 0, panels):
                            continue
                        du, dv, dw = fluid[VX, j] - u, sign * fluid[VY, j] - v, fluid[VZ, j] - w
                        force, drag, ex, ey, ez, _, _, along = wall_terms(
                            (ax, ay, az, r2),
                            du,
                            dv,
                            dw,
                            normal,
                            elements[NORMAL_ACCELERATION, e],
                            elements[AREA, e],
                            signed[channel, j],
                            fluid[DENSITY, j],
                            fluid[PRESSURE, j],
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
