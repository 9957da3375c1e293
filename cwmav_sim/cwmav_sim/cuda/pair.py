# SPDX-License-Identifier: Apache-2.0
"""The interaction formula of ``cwmav_sim.sph.pair`` for one pair, added to the sums of a particle."""

from __future__ import annotations

import math

from numba import cuda

from cwmav_sim.sph.pair import CLUMPING, ETA2, FOUR, HALF_OVER_H, ONE, TWICE_RHO0, TWO, ZERO

SUMS = 11


@cuda.jit(device=True)
def no_sums(k):
    """Return the sums before the first pair."""
    zero = k[ZERO]
    return zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero


@cuda.jit(device=True, fastmath=True)
def add_pair(sums, apart, a, b, k, shifting):
    """Return the sums of a particle with one more neighbour.

    Parameters
    ----------
    sums : tuple of 11 floats
        Divergence, diffusion, pressure (3), viscosity (3), shifting (3), each without the kernel slope.
    apart : tuple of 4 floats
        Vector from the neighbour to the particle [m] and its squared length [m2].
    a : tuple of 5 floats
        Velocity of the particle (3) [m/s], density above rest [kg/m3], pressure [Pa].
    b : tuple of 6 floats
        The same of the neighbour, and its volume [m3], zero where it is hidden by a wall.
    k : tuple of 8 floats
        Pair constants.
    shifting : bool
        Whether the shifting sum is wanted.
    """
    div, dif, px, py, pz, fx, fy, fz, sx, sy, sz = sums
    dx, dy, dz, r2 = apart
    ua, va, wa, da, pa = a
    ub, vb, wb, db, pb, volume = b
    one = k[ONE]
    t = max(one - math.sqrt(r2) * k[HALF_OVER_H], k[ZERO])
    f = t * t * t * volume
    du, dv, dw = ua - ub, va - vb, wa - wb
    rho_sum = da + k[TWICE_RHO0] + db
    g = f * r2 * (one / ((r2 + k[ETA2]) * rho_sum))
    div += f * (du * dx + dv * dy + dw * dz)
    dif += (db - da) * g * rho_sum
    c = f * (pa + pb)
    px += c * dx
    py += c * dy
    pz += c * dz
    c = g * (k[TWICE_RHO0] / k[TWO] + db)
    fx += c * du
    fy += c * dv
    fz += c * dw
    if shifting:
        clump = t * t
        clump = clump * clump * (k[FOUR] * (one - t) + one) * k[CLUMPING]
        clump = clump * clump
        c = f + f * (clump * clump)
        sx += c * dx
        sy += c * dy
        sz += c * dz
    return div, dif, px, py, pz, fx, fy, fz, sx, sy, sz
