# SPDX-License-Identifier: Apache-2.0
"""The wall sums of the particles near walls, and the forces on the walls."""

from __future__ import annotations

import numba as nb
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
from cwmav_sim.cuda.launch import THREADS
from cwmav_sim.cuda.rows import REACH, laps, layer, row, run
from cwmav_sim.cuda.vector import DENSITY, PLACE_X, PLACE_Y, PLACE_Z, four, two
from cwmav_sim.cuda.visibility import hidden
from cwmav_sim.cuda.wall import wall_terms
from cwmav_sim.sph.forces import LOAD_SIZE, MASS, RHO0
from cwmav_sim.sph.wall import (
    AREA,
    EVX,
    EVY,
    EVZ,
    EX,
    EY,
    EZ,
    NORMAL_ACCELERATION,
)
from cwmav_sim.sph.wall import (
    NX as NORMAL_X,
)
from cwmav_sim.sph.wall import (
    NY as NORMAL_Y,
)
from cwmav_sim.sph.wall import (
    NZ as NORMAL_Z,
)


@cuda.jit(device=True, fastmath=True)
def _sum_channel(
    place,
    move,
    state,
    i,
    cell_place,
    c,
    signed,
    inside,
    elements,
    element_column,
    start,
    base_cell,
    signed_e,
    inside_e,
    panels,
    integers,
    reach,
    k,
):
    """Return the twelve wall sums of the particle at place ``i`` for one wall or one image of a wall."""
    cx, cy, cz = cell_place
    nx, reach_y = integers[NX], integers[REACH_Y]
    one, zero = reach[ONE], reach[ZERO]
    x, y, z, column = four(place, i)
    ua, va, wa, _ = four(move, i)
    density, pressure = two(state, i)
    first_lap, last_lap = laps(nx, cx - REACH, cx + REACH)
    first_column = column + reach[COLUMNS] if first_lap < 0 else column
    image = 1 if c < panels else -1
    sign = one if c < panels else -one
    side_a = signed[c, i]
    px = py = pz = fx = fy = fz = div = sx = sy = sz = pp = pf = zero
    shift_z = reach[MINUS_TWO]
    for dz in range(-REACH, REACH + 1):
        first_row = layer(integers, cz, dz)
        shift_y = reach[MINUS_TWO] if reach_y > 0 else zero
        for dy in range(-reach_y, reach_y + 1):
            base, side = row(integers, first_row, cy, dy)
            if side == image:
                # All cells of the row: an element of a wall that crosses the mirror lies outside its cell.
                column_a = first_column
                for lap in range(first_lap, last_lap + 1):
                    first, last = run(start, base_cell + base, nx, cx - REACH, cx + REACH, lap)
                    for j in range(first, last):
                        ax = x - elements[EX, j] + (column_a - element_column[j]) * reach[CELL_X]
                        ay = y - shift_y * reach[CELL_Y] - sign * elements[EY, j]
                        az = z - shift_z * reach[CELL_Z] - elements[EZ, j]
                        r2 = ax * ax + ay * ay + az * az
                        if r2 >= reach[SUPPORT2]:
                            continue
                        if hidden(signed, inside, i, signed_e, inside_e, j, image < 0, panels):
                            continue
                        u, v, w = elements[EVX, j], sign * elements[EVY, j], elements[EVZ, j]
                        du, dv, dw = ua - u, va - v, wa - w
                        force, drag, ex, ey, ez, divergence, shifted, _ = wall_terms(
                            (ax, ay, az, r2),
                            du,
                            dv,
                            dw,
                            (elements[NORMAL_X, j], sign * elements[NORMAL_Y, j], elements[NORMAL_Z, j]),
                            elements[NORMAL_ACCELERATION, j],
                            elements[AREA, j],
                            side_a,
                            density,
                            pressure,
                            k,
                        )
                        px += force * ex
                        py += force * ey
                        pz += force * ez
                        pp += force * (ex * u + ey * v + ez * w)
                        fx += drag * du
                        fy += drag * dv
                        fz += drag * dw
                        pf += drag * (du * u + dv * v + dw * w)
                        div += divergence
                        sx += shifted * ex
                        sy += shifted * ey
                        sz += shifted * ez
                    column_a -= reach[COLUMNS]
            shift_y += one
        shift_z += one
    return px, py, pz, fx, fy, fz, div, sx, sy, sz, pp, pf


@cuda.jit(cache=True, fastmath=True)
def wall_pass(
    place,
    move,
    state,
    cell_of,
    order,
    near,
    listed,
    signed,
    inside,
    elements,
    element_column,
    start,
    cells,
    signed_e,
    inside_e,
    panels,
    low,
    cell,
    integers,
    reach,
    k,
    scale,
    shifting,
    acceleration,
    density_rate,
    shift,
    partial,
):
    """Add the wall sums of the listed particles to their rates; every block leaves its wall loads.

    ``partial``, shape (11 panels, blocks), receives per panel pressure force (3), viscous force (3), power of
    the two on the moving wall and moment about the origin (3).
    """
    part = cuda.shared.array((LOAD_SIZE, THREADS), nb.float64)
    t = cuda.threadIdx.x
    b = cuda.blockIdx.x
    total = near[near.shape[0] - 1]
    for q in range(t, partial.shape[0], THREADS):
        partial[q, b] = 0.0
    if b * THREADS >= total:
        return
    cuda.syncthreads()
    at = cuda.grid(1)
    i = listed[at] if at < total else listed[0]
    cell_place = place_of(cell_of[i], integers)
    cx, cy, cz = cell_place
    x = low[0] + (cx + 0.5) * cell[0] + place[i, PLACE_X]
    y = low[1] + (cy + 0.5) * cell[1] + place[i, PLACE_Y]
    z = low[2] + (cz + 0.5) * cell[2] + place[i, PLACE_Z]
    number = order[i]
    mass = scale[MASS]
    for c in range(signed.shape[0]):
        panel = c if c < panels else c - panels
        for q in range(LOAD_SIZE):
            part[q, t] = 0.0
        if at < total:
            px, py, pz, fx, fy, fz, div, sx, sy, sz, pp, pf = _sum_channel(
                place,
                move,
                state,
                i,
                cell_place,
                c,
                signed,
                inside,
                elements,
                element_column,
                start,
                panel * cells,
                signed_e,
                inside_e,
                panels,
                integers,
                reach,
                k,
            )
            acceleration[0, number] += px + fx
            acceleration[1, number] += py + fy
            acceleration[2, number] += pz + fz
            density_rate[number] += (scale[RHO0] + state[i, DENSITY]) * div
            if shifting:
                shift[0, number] += sx
                shift[1, number] += sy
                shift[2, number] += sz
            # The load on an image is the mirror of one on the wall itself.
            mirror = 1.0 if c < panels else -1.0
            lx, ly, lz = -mass * (px + fx), -mass * (py + fy), -mass * (pz + fz)
            part[0, t] = -mass * px
            part[1, t] = -mass * py * mirror
            part[2, t] = -mass * pz
            part[3, t] = -mass * fx
            part[4, t] = -mass * fy * mirror
            part[5, t] = -mass * fz
            part[6, t] = -mass * pp
            part[7, t] = -mass * pf
            part[8, t] = (y * lz - z * ly) * mirror
            part[9, t] = z * lx - x * lz
            part[10, t] = (x * ly - y * lx) * mirror
        cuda.syncthreads()
        if t < LOAD_SIZE:
            found = 0.0
            for q in range(THREADS):
                found += part[t, q]
            partial[panel * LOAD_SIZE + t, b] += found
        cuda.syncthreads()
