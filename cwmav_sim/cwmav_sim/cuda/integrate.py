# SPDX-License-Identifier: Apache-2.0
"""The step in time on the card: prediction, correction, easing, fringe and the faces of the box.

The formulas are those of ``cwmav_sim.sph.integrate``, ``easing`` and ``stream``; one kernel does all that
follows a pass, and every block leaves what the host wants to know of its particles.
"""

from __future__ import annotations

import math

import numba as nb
from numba import cuda

from cwmav_sim.cuda.launch import THREADS
from cwmav_sim.sph.easing import EASE

# Rows that the blocks of a correction leave: largest squared speed and acceleration, sum of the velocity
# changes in the fringe (3) and of the changes of half the squared speed there.
SPEED2, ACCELERATION2, CHANGE_X, CHANGE_Y, CHANGE_Z, WORK = range(6)
CORRECTION_ROWS, LARGEST_ROWS = 6, 2

# Places in the constants of a correction.
LIMIT, DP, KEEP_OUT, FRINGE_BEGIN, FRINGE_WIDTH, FRINGE_RATE, STREAM, RHO0, AROUND_LOW, AROUND_SIZE = range(
    10
)


@cuda.jit(device=True)
def around(x, low, size):
    """Return a coordinate [m] brought around the periodic faces into the box."""
    offset = x - low
    if offset < 0.0 or offset >= size:
        offset -= size * math.floor(offset / size)
        if offset >= size:
            offset = 0.0
        return low + offset
    return x


@cuda.jit(device=True)
def confine(x, y, z, vy, low, size, mirrored):
    """Return position and y velocity of a particle brought around periodic faces and off mirrors."""
    if mirrored:
        high = low[1] + size[1]
        if y < low[1]:
            y = 2.0 * low[1] - y
            vy = -vy
        elif y > high:
            y = 2.0 * high - y
            vy = -vy
    else:
        y = around(y, low[1], size[1])
    return around(x, low[0], size[0]), y, around(z, low[2], size[2]), vy


@cuda.jit(cache=True)
def confine_all(x, v, low, size, mirrored):
    """Bring all particles back into the box, in place."""
    i = cuda.grid(1)
    if i < x.shape[1]:
        px, py, pz, vy = confine(x[0, i], x[1, i], x[2, i], v[1, i], low, size, mirrored)
        x[0, i] = px
        x[1, i] = py
        x[2, i] = pz
        v[1, i] = vy


@cuda.jit(cache=True)
def predict(x, v, rho, acceleration, density_rate, half, low, size, mirrored, x_out, v_out, rho_out, partial):
    """Fill in the particles ``half`` [s] ahead, and the largest squared acceleration of every block."""
    part = cuda.shared.array(THREADS, nb.float64)
    i = cuda.grid(1)
    t = cuda.threadIdx.x
    part[t] = 0.0
    if i < rho.shape[0]:
        ax, ay, az = acceleration[0, i], acceleration[1, i], acceleration[2, i]
        part[t] = ax * ax + ay * ay + az * az
        px, py, pz, vy = confine(
            x[0, i] + half * v[0, i],
            x[1, i] + half * v[1, i],
            x[2, i] + half * v[2, i],
            v[1, i] + half * ay,
            low,
            size,
            mirrored,
        )
        x_out[0, i] = px
        x_out[1, i] = py
        x_out[2, i] = pz
        v_out[0, i] = v[0, i] + half * ax
        v_out[1, i] = vy
        v_out[2, i] = v[2, i] + half * az
        rho_out[i] = rho[i] + half * density_rate[i]
    cuda.syncthreads()
    if t == 0:
        found = 0.0
        for q in range(THREADS):
            found = max(found, part[q])
        partial[0, cuda.blockIdx.x] = found


@cuda.jit(device=True)
def fringe_shape(x, z, k):
    """Return the share of the largest relaxation rate at a place."""
    shape = _bump((x - k[FRINGE_BEGIN]) / k[FRINGE_WIDTH])
    if k[AROUND_SIZE] > 0.0:
        height = z - k[AROUND_LOW] + 0.5 * k[FRINGE_WIDTH]
        height -= k[AROUND_SIZE] * math.floor(height / k[AROUND_SIZE])
        shape = max(shape, _bump(height / k[FRINGE_WIDTH]))
    return shape


@cuda.jit(device=True)
def _bump(share):
    if share <= 0.0 or share >= 1.0:
        return 0.0
    wave = math.sin(math.pi * share)
    return wave * wave


@cuda.jit(device=True)
def eased(mx, my, mz, sides, i, k):
    """Return the move of a particle [m] clipped, kept off the walls and eased away from them."""
    length = math.sqrt(mx * mx + my * my + mz * mz)
    if length > k[LIMIT]:
        mx *= k[LIMIT] / length
        my *= k[LIMIT] / length
        mz *= k[LIMIT] / length
    for panel in range(sides.shape[0]):
        s = sides[panel, 0, i]
        distance = abs(s)
        if s != 0.0 and distance < k[DP] and sides[panel, 1, i] > 0.0:
            side = 1.0 if s > 0.0 else -1.0
            nx, ny, nz = sides[panel, 2, i], sides[panel, 3, i], sides[panel, 4, i]
            away = side * mx * nx + side * my * ny + side * mz * nz
            push = (max(-away, 0.0) + EASE * max(k[KEEP_OUT] - distance, 0.0)) * side
            mx += push * nx
            my += push * ny
            mz += push * nz
    return mx, my, mz


@cuda.jit(cache=True)
def correct(
    x, v, rho, middle, acceleration, density_rate, shift, sides, dt, strength, k, low, size, mirrored, partial
):
    """Bring the particles a whole step of ``dt`` [s] ahead, in place.

    Parameters
    ----------
    x, v, rho : array, shape (3, n), (3, n) and (n,)
        Particles at the begin of the step.
    middle : array, shape (n,)
        Densities at its middle [kg/m3].
    acceleration, density_rate, shift, sides : array
        Rates and sides there.
    dt, strength : float
        Step [s] and factor of the shifting [m2].
    k : tuple of 10 float
        Constants of the correction.
    low, size, mirrored : tuple, tuple, bool
        Of the box.
    partial : array, shape (6, blocks)
        Filled with the maxima and sums of every block.
    """
    part = cuda.shared.array((CORRECTION_ROWS, THREADS), nb.float64)
    i = cuda.grid(1)
    t = cuda.threadIdx.x
    for q in range(CORRECTION_ROWS):
        part[q, t] = 0.0
    if i < rho.shape[0]:
        ax, ay, az = acceleration[0, i], acceleration[1, i], acceleration[2, i]
        part[ACCELERATION2, t] = ax * ax + ay * ay + az * az
        ux, uy, uz = v[0, i] + dt * ax, v[1, i] + dt * ay, v[2, i] + dt * az
        e = -density_rate[i] * dt / middle[i]
        density = rho[i] * (2.0 - e) / (2.0 + e)
        mx, my, mz = eased(
            -strength * shift[0, i], -strength * shift[1, i], -strength * shift[2, i], sides, i, k
        )
        px = x[0, i] + 0.5 * dt * (v[0, i] + ux) + mx
        py = x[1, i] + 0.5 * dt * (v[1, i] + uy) + my
        pz = x[2, i] + 0.5 * dt * (v[2, i] + uz) + mz
        if k[FRINGE_WIDTH] > 0.0:
            shape = fringe_shape(px, pz, k)
            if shape > 0.0:
                keep = math.exp(-k[FRINGE_RATE] * shape * dt)
                before = ux * ux + uy * uy + uz * uz
                cx, cy, cz = (1.0 - keep) * (k[STREAM] - ux), (keep - 1.0) * uy, (keep - 1.0) * uz
                ux += cx
                uy += cy
                uz += cz
                density = k[RHO0] + keep * (density - k[RHO0])
                part[CHANGE_X, t] = cx
                part[CHANGE_Y, t] = cy
                part[CHANGE_Z, t] = cz
                part[WORK, t] = 0.5 * (ux * ux + uy * uy + uz * uz - before)
        speed2 = ux * ux + uy * uy + uz * uz
        if not (math.isfinite(speed2) and math.isfinite(density)):
            speed2 = math.inf
        part[SPEED2, t] = speed2
        px, py, pz, uy = confine(px, py, pz, uy, low, size, mirrored)
        x[0, i] = px
        x[1, i] = py
        x[2, i] = pz
        v[0, i] = ux
        v[1, i] = uy
        v[2, i] = uz
        rho[i] = density
    cuda.syncthreads()
    if t < CORRECTION_ROWS:
        found = 0.0
        for q in range(THREADS):
            found = max(found, part[t, q]) if t < LARGEST_ROWS else found + part[t, q]
        partial[t, cuda.blockIdx.x] = found


@cuda.jit(cache=True)
def reorder(order, x, v, rho, identity, sides, x_out, v_out, rho_out, identity_out, sides_out):
    """Store the particles, and what is kept of their sides, in another order."""
    j = cuda.grid(1)
    if j < order.shape[0]:
        i = order[j]
        for q in range(3):
            x_out[q, j] = x[q, i]
            v_out[q, j] = v[q, i]
        rho_out[j] = rho[i]
        identity_out[j] = identity[i]
        for panel in range(sides.shape[0]):
            for q in range(5):
                sides_out[panel, q, j] = sides[panel, q, i]


@cuda.jit(cache=True)
def half_squares(v, partial):
    """Fill in the sum of the velocities (3) and of half their squares of every block, shape (4, blocks)."""
    part = cuda.shared.array((4, THREADS), nb.float64)
    i = cuda.grid(1)
    t = cuda.threadIdx.x
    for q in range(4):
        part[q, t] = 0.0
    if i < v.shape[1]:
        for q in range(3):
            part[q, t] = v[q, i]
            part[3, t] += 0.5 * v[q, i] * v[q, i]
    cuda.syncthreads()
    if t < 4:
        found = 0.0
        for q in range(THREADS):
            found += part[t, q]
        partial[t, cuda.blockIdx.x] = found
