# SPDX-License-Identifier: Apache-2.0
"""The wall formula of ``cwmav_sim.sph.wall`` for one particle and one element."""

from __future__ import annotations

import math

from numba import cuda

from cwmav_sim.sph.wall import (
    APPROACH,
    C_FACTOR,
    COEFFICIENTS,
    DIFFUSION,
    FOUR,
    G0_FACTOR,
    G1_FACTOR,
    HALF_OVER_H,
    HALF_SPACE,
    NEAREST,
    ONE,
    RHO0,
    SOUND,
    THREE_D,
    TINY,
    TWICE_NU,
    TWO,
    ZERO,
)


@cuda.jit(device=True, fastmath=True)
def wall_terms(apart, du, dv, dw, normal, acceleration, area, side, density, pressure, k):
    """Return what one element adds to the sums of a particle.

    Parameters
    ----------
    apart : tuple of 4 floats
        Vector from the element to the particle [m] and its squared length [m2].
    du, dv, dw : float
        Velocity of the particle less that of the element [m/s].
    normal : tuple of 3 floats
        Unit normal of the element.
    acceleration, area : float
        Acceleration of the element along its normal [m/s2], and its area [m2], zero where hidden.
    side : float
        Signed distance of the particle from the wall [m].
    density, pressure : float
        Density of the particle above rest [kg/m3] and its pressure [Pa].
    k : tuple of 32 floats
        Wall constants.

    Returns
    -------
    tuple of 8 floats
        Pressure acceleration along the direction to the particle [m/s2], factor of the relative velocity in
        the viscous acceleration [1/s], that direction (3), rate of relative density [1/s], shifting along
        the direction [1/m], and the air carried along per mass of the particle.
    """
    dx, dy, dz, r2 = apart
    nx, ny, nz = normal
    one, two, four, zero = k[ONE], k[TWO], k[FOUR], k[ZERO]
    r = math.sqrt(r2) + k[TINY]
    inverse = one / r
    t = max(one - r * k[HALF_OVER_H], zero)
    t4 = t * t
    t4 = t4 * t4
    g0 = (
        k[G0_FACTOR]
        * t4
        * (k[COEFFICIENTS] + t * (k[COEFFICIENTS + 1] + t * (k[COEFFICIENTS + 2] + t * k[COEFFICIENTS + 3])))
    )
    g1 = (
        k[G1_FACTOR]
        * t4
        * (
            k[COEFFICIENTS + 5]
            + t
            * (
                k[COEFFICIENTS + 6]
                + t * (k[COEFFICIENTS + 7] + t * (k[COEFFICIENTS + 8] + t * k[COEFFICIENTS + 9]))
            )
        )
    )
    c = k[C_FACTOR] * t4 * (k[COEFFICIENTS + 10] + t * (k[COEFFICIENTS + 11] + t * k[COEFFICIENTS + 12]))
    near = min(inverse, one / k[NEAREST])
    ex, ey, ez = dx * inverse, dy * inverse, dz * inverse
    ne = nx * ex + ny * ey + nz * ez
    omega = min(abs(ne) * area * inverse * (k[THREE_D] * inverse + (one - k[THREE_D])), k[HALF_SPACE])
    if ne * side < zero:
        omega = zero
    away = du * ex + dv * ey + dw * ez
    divergence = omega * (away * max(g1 * near, four * g0) - k[DIFFUSION] * acceleration * ne * g0)
    facing = one if ne > zero else -one
    speed = max(-(du * nx + dv * ny + dw * nz) * facing, zero)
    extra = speed * speed * min(k[APPROACH], k[SOUND] / (speed + k[TINY]))
    rho = k[RHO0] + density
    force = -omega * (one / rho) * ((two * pressure + rho * extra) * g0 + rho * acceleration * ne * g1)
    drag = k[TWICE_NU] * omega * max(g0 * near, four * c)
    return force, drag, ex, ey, ez, divergence, omega * g0, omega * ne * ne * g1
