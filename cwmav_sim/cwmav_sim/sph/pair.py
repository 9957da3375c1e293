# SPDX-License-Identifier: Apache-2.0
"""The one interaction formula of the fluid, summed over a buffer of neighbours.

For a particle a and neighbours b, with r = x_a - x_b, grad W = F r, V_b = m_b / rho_b and
eta^2 = 0.01 h^2, the sums are

    continuity   sum V_b (v_a - v_b) . grad W
                 - (D / rho_a) sum V_b (rho_b - rho_a) r . grad W / (r^2 + eta^2)
    momentum     sum V_b (p_a + p_b) grad W
                 - 4 nu rho_a sum m_b (v_a - v_b) r . grad W / [(r^2 + eta^2)(rho_a + rho_b)]
    shifting     sum V_b [1 + k (W / W(dp))^4] grad W

(Monaghan 1994 for pressure and continuity; Fourtakas et al., Comput. Fluids 190 (2019) 346 for the
diffusion; Lo & Shao, Appl. Ocean Res. 24 (2002) 275 for viscosity; Lind et al., J. Comput. Phys. 231 (2012)
1499 for shifting.) The loop has no branch: max(1 - q/2, 0) removes what lies outside the support, the
particle itself contributes nothing because r = 0, and a hidden neighbour has its volume V_b set to zero.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.blocks import long_vectors

# Rows of the packed fluid and of a neighbour buffer.
X, Y, Z, VX, VY, VZ, DENSITY, PRESSURE, VOLUME = range(9)
FLUID_ROWS = 9

# Places in the array of pair constants.
HALF_OVER_H, ETA2, TWICE_RHO0, ONE, TWO, FOUR, ZERO, CLUMPING = range(8)

WORK_ROWS = 2  # of the space that sums need, as long as a buffer


def pair_constants(
    h: float, rho0: float, spacing_value: float, amplitude: float, tensile: float, dtype: np.dtype
) -> NDArray:
    """Return the constants of the pair sums in the precision of the pairs, shape (8,).

    Parameters
    ----------
    h, rho0 : float
        Smoothing length [m] and density at rest [kg/m3].
    spacing_value, amplitude : float
        Kernel at one particle spacing and its factor A.
    tensile : float
        Weight of the anti-clumping term of shifting.
    dtype : numpy.dtype
        float32 or float64.
    """
    clumping = amplitude / spacing_value * tensile**0.25  # k (W / W(dp))^4 = (clumping W / A)^4
    values = [0.5 / h, 0.01 * h * h, 2.0 * rho0, 1.0, 2.0, 4.0, 0.0, clumping]
    return np.array(values, dtype=dtype)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def pack_fluid(local, v, rho, pressure, order, mass, rho0, fluid):
    """Pack particles in cell order, in the precision of the pairs.

    Parameters
    ----------
    local : ndarray, shape (n, 3)
        Positions relative to the centres of the own cells [m], in cell order.
    v, rho, pressure : ndarray, shape (n, 3), (n,), (n,)
        Velocities [m/s], densities [kg/m3] and pressures [Pa], in storage order.
    order : ndarray, shape (n,), int
        Number of the particle at each place.
    mass, rho0 : float
        Mass of a particle [kg] and density at rest [kg/m3].
    fluid : ndarray, shape (9, n)
        Filled; its densities are those above rest, so that single precision resolves them.
    """
    for j in nb.prange(order.shape[0]):
        i = order[j]
        for q in range(3):
            fluid[X + q, j] = local[j, q]
            fluid[VX + q, j] = v[i, q]
        fluid[DENSITY, j] = rho[i] - rho0
        fluid[PRESSURE, j] = pressure[i]
        fluid[VOLUME, j] = mass / rho[i]


# Inlined by force: a call could end in another copy, with sums in another order (docs/decisions/0013).
@nb.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
def sum_pairs(a, factors, buf, volume, n, k, shifting, work):
    """Sum the interaction of one particle over the first ``n`` entries of a buffer of neighbours.

    Parameters
    ----------
    a : tuple of 8 floats
        x, y, z, vx, vy, vz, density above rest, pressure of the particle.
    factors : tuple of 2 floats
        D / rho_a [m5/(kg s)] and 4 nu rho_a [kg/(m s)] of the particle.
    buf : ndarray, shape (9, m)
        Neighbours, rows as in the packed fluid.
    volume : ndarray, shape (m,)
        Volume of each neighbour, zero where hidden by a wall.
    n : int
        Number of entries to use.
    k : ndarray, shape (8,)
        Pair constants.
    shifting : bool
        Whether the shifting sum is wanted.
    work : ndarray, shape (2, m)
        Overwritten.

    Returns
    -------
    tuple of 7 floats
        Continuity, momentum (3), shifting (3), each without the kernel slope factor.
    """
    # With a constant, a loop each is compiled and vectorised; with a variable the terms are only masked.
    if shifting:
        return _sum(a, factors, buf, volume, n, k, True, work)
    return _sum(a, factors, buf, volume, n, k, False, work)


@nb.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
def _sum(a, factors, buf, volume, n, k, shifting, work):
    long_vectors()
    xa, ya, za, ua, va, wa, da, pa = a
    half_over_h, eta2, one, zero, two, four = k[HALF_OVER_H], k[ETA2], k[ONE], k[ZERO], k[TWO], k[FOUR]
    rho_a, rho0 = da + k[TWICE_RHO0], k[TWICE_RHO0] / two
    clump_4 = four * k[CLUMPING]
    clump_5 = clump_4 + k[CLUMPING]
    diffusion, viscosity = factors
    diffusion_a, viscosity_0 = diffusion * da, viscosity * rho0
    x, y, z = buf[X][:n], buf[Y][:n], buf[Z][:n]
    u, v, w = buf[VX][:n], buf[VY][:n], buf[VZ][:n]
    density, pressure, volume = buf[DENSITY][:n], buf[PRESSURE][:n], volume[:n]
    slope, radial = work[0][:n], work[1][:n]
    continuity = mx = my = mz = sx = sy = sz = zero
    # Two loops: in a single one a pair waits so long for root and division that few are under way at once.
    for j in range(n):
        dx, dy, dz = xa - x[j], ya - y[j], za - z[j]
        r2 = dx * dx + dy * dy + dz * dz
        t = max(one - np.sqrt(r2) * half_over_h, zero)
        f = t * t * t * volume[j]
        slope[j] = f
        radial[j] = f * r2 / ((r2 + eta2) * (rho_a + density[j]))
        if shifting:
            clump = t * t
            clump = clump * clump * (clump_5 - clump_4 * t)
            clump = clump * clump
            c = f + f * (clump * clump)
            sx += c * dx
            sy += c * dy
            sz += c * dz
    for j in range(n):
        dx, dy, dz = xa - x[j], ya - y[j], za - z[j]
        du, dv, dw = ua - u[j], va - v[j], wa - w[j]
        f, g = slope[j], radial[j]
        rise = (diffusion * density[j] - diffusion_a) * (rho_a + density[j])
        continuity += f * (du * dx + dv * dy + dw * dz) - g * rise
        c = f * (pa + pressure[j])
        d = g * (viscosity_0 + viscosity * density[j])
        mx += c * dx - d * du
        my += c * dy - d * dv
        mz += c * dz - d * dw
    return continuity, mx, my, mz, sx, sy, sz
