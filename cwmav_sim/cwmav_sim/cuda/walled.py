# SPDX-License-Identifier: Apache-2.0
"""The wall sums of the particles near walls, and the forces on the walls.

Few particles have walls around them, and those have many elements each, so a group of threads shares the
elements of one particle. The number of blocks is fixed; they take one set of particles after the other.
"""

from __future__ import annotations

import numba as nb
from numba import config, cuda

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
from cwmav_sim.cuda.launch import LANES, THREADS
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

GROUPS = THREADS // LANES  # particles that a block works on at a time
WALL_BLOCKS = 4 if config.ENABLE_CUDASIM else 1024  # as many as a large card works on at a time
_SUMS = 12


@cuda.jit(device=True, fastmath=True)
def _sum_channel(
    place,
    move,
    state,
    i,
    lane,
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
    """Return one lane's part of the twelve sums of the particle at place ``i`` for a wall or an image."""
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
                    for j in range(first + lane, last, LANES):
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

    ``partial``, shape (11 panels, WALL_BLOCKS), receives per panel pressure force (3), viscous force (3),
    power of the two on the moving wall and moment about the origin (3).
    """
    part = cuda.shared.array((_SUMS, THREADS), nb.float64)
    total = cuda.shared.array((_SUMS, GROUPS), nb.float64)
    load = cuda.shared.array((LOAD_SIZE, GROUPS), nb.float64)
    t, b = cuda.threadIdx.x, cuda.blockIdx.x
    group, lane = t // LANES, t % LANES
    number_near = near[near.shape[0] - 1]
    for q in range(t, partial.shape[0], THREADS):
        partial[q, b] = 0.0
    cuda.syncthreads()
    for first in range(b * GROUPS, number_near, WALL_BLOCKS * GROUPS):
        there = first + group < number_near
        i = listed[first + group] if there else listed[first]
        cell_place = place_of(cell_of[i], integers)
        for c in range(signed.shape[0]):
            panel = c if c < panels else c - panels
            sums = _sum_channel(
                place,
                move,
                state,
                i,
                lane,
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
            _keep(sums, part, t)
            cuda.syncthreads()
            for w in range(t, _SUMS * GROUPS, THREADS):
                q, g = w // GROUPS, w % GROUPS
                found = 0.0
                for p in range(g * LANES, (g + 1) * LANES):
                    found += part[q, p]
                total[q, g] = found
            cuda.syncthreads()
            if lane == 0:
                mirror = 1.0 if c < panels else -1.0
                position = _position(place, i, cell_place, low, cell)
                _load(total, group, position, scale[MASS] if there else 0.0, mirror, load)
                if there:
                    number = order[i]
                    acceleration[0, number] += total[0, group] + total[3, group]
                    acceleration[1, number] += total[1, group] + total[4, group]
                    acceleration[2, number] += total[2, group] + total[5, group]
                    density_rate[number] += (scale[RHO0] + state[i, DENSITY]) * total[6, group]
                    if shifting:
                        for q in range(3):
                            shift[q, number] += total[7 + q, group]
            cuda.syncthreads()
            for q in range(t, LOAD_SIZE, THREADS):
                found = 0.0
                for g in range(GROUPS):
                    found += load[q, g]
                partial[panel * LOAD_SIZE + q, b] += found
            cuda.syncthreads()


@cuda.jit(device=True)
def _keep(sums, part, t):
    """Leave the twelve sums of a thread where its block finds them."""
    px, py, pz, fx, fy, fz, div, sx, sy, sz, pp, pf = sums
    part[0, t] = px
    part[1, t] = py
    part[2, t] = pz
    part[3, t] = fx
    part[4, t] = fy
    part[5, t] = fz
    part[6, t] = div
    part[7, t] = sx
    part[8, t] = sy
    part[9, t] = sz
    part[10, t] = pp
    part[11, t] = pf


@cuda.jit(device=True)
def _position(place, i, cell_place, low, cell):
    """Return the position [m] of the particle at place ``i``."""
    cx, cy, cz = cell_place
    x = low[0] + (cx + 0.5) * cell[0] + place[i, PLACE_X]
    y = low[1] + (cy + 0.5) * cell[1] + place[i, PLACE_Y]
    z = low[2] + (cz + 0.5) * cell[2] + place[i, PLACE_Z]
    return x, y, z


@cuda.jit(device=True)
def _load(total, group, position, mass, mirror, load):
    """Fill in the load of a particle on a wall; that on an image is the mirror of one on the wall itself."""
    x, y, z = position
    px, py, pz = -mass * total[0, group], -mass * total[1, group], -mass * total[2, group]
    fx, fy, fz = -mass * total[3, group], -mass * total[4, group], -mass * total[5, group]
    lx, ly, lz = px + fx, py + fy, pz + fz
    load[0, group] = px
    load[1, group] = py * mirror
    load[2, group] = pz
    load[3, group] = fx
    load[4, group] = fy * mirror
    load[5, group] = fz
    load[6, group] = -mass * total[10, group]
    load[7, group] = -mass * total[11, group]
    load[8, group] = (y * lz - z * ly) * mirror
    load[9, group] = z * lx - x * lz
    load[10, group] = (x * ly - y * lx) * mirror
