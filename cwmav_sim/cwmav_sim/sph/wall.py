# SPDX-License-Identifier: Apache-2.0
"""What the air behind a thin wall would have contributed to the sums of a particle.

The wall hides the other half of the support. That half is filled, along every ray that meets the wall, with
a mirror state and integrated exactly: for a surface element dS with unit normal n at distance r from the
particle, e the unit vector from the element to the particle and d the dimension,

    omega = |n.e| dS / r^(d-1)                  (solid angle, at most that of a half space)
    G0 = integral W' s^(d-1) ds = -5 A h^(d-1) J_d(r/h)             from r to 2h
    G1 = integral W' s^d ds     = -5 A h^d J_(d+1)(r/h)
    C  = integral W' s^(d-2) ds = -5 A h^(d-2) J_(d-1)(r/h)

    pressure    dv/dt   -= (1/rho) omega e [(2p + p_i) G0 + rho (a_w.n)(n.e) G1]
    viscosity   dv/dt   += 2 nu omega (v - v_w) max(G0/r', 4 C)
    continuity  drho/dt += rho omega [(v - v_w).e max(G1/r', 4 G0) - D (a_w.n)(n.e) G0],  D = 2 delta h/c0
    shifting            += omega e G0

The mirror state carries the pressure of the particle itself, raised by the acceleration a_w of the wall less
gravity, and a velocity antisymmetric about the wall that is limited near it, r' = max(r, dp/4). Its
density follows its pressure, so the diffusion sees no step at a wall whose air is in equilibrium. Only
elements that face the particle count: those of a bent or closed wall whose other face looks at it are
hidden by the wall itself. The pressure
p_i = rho c0 u min(b u/c0, 1) resists an approach at speed u when the factor b is not zero. The wall takes the
opposite force.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.blocks import long_vectors
from cwmav_sim.sph.kernel import Kernel, ray_integral_coefficients

# Rows of the packed wall elements and of their buffers.
EX, EY, EZ, EVX, EVY, EVZ, NX, NY, NZ, NORMAL_ACCELERATION, AREA = range(11)
ELEMENTS = 3, 2  # vectors and scalars among them
ELEMENT_ROWS = 11

(
    HALF_OVER_H,
    NEAREST,
    G0_FACTOR,
    G1_FACTOR,
    C_FACTOR,
    TWICE_NU,
    SOUND,
    APPROACH,
    RHO0,
    ONE,
    TWO,
    FOUR,
    ZERO,
    THREE_D,
    TINY,
    HALF_SPACE,
    DIFFUSION,
) = range(17)
COEFFICIENTS = 17  # first place of the three polynomials of five factors each


def wall_constants(
    kernel: Kernel,
    dp: float,
    viscosity: float,
    sound_speed: float,
    approach_damping: float,
    density: float,
    diffusion: float,
    dtype: np.dtype,
) -> NDArray:
    """Return the constants of the wall sums in the precision of the pairs, shape (32,)."""
    h, d = kernel.h, kernel.dimensions
    five_a = -5.0 * kernel.amplitude
    head = [
        0.5 / h,
        0.25 * dp,
        five_a * h ** (d - 1),
        five_a * h**d,
        five_a * h ** (d - 2),
        2.0 * viscosity,
        sound_speed,
        approach_damping,
        density,
        1.0,
        2.0,
        4.0,
        0.0,
        1.0 if d == 3 else 0.0,
        1e-6 * dp,
        np.pi * (d - 1),
        2.0 * diffusion * h / sound_speed,
    ]
    polynomials = np.zeros((3, 5))
    for row, k in enumerate((d, d + 1, d - 1)):
        polynomials[row, : k + 1] = ray_integral_coefficients(k)
    return np.array([*head, *polynomials.ravel()], dtype=dtype)


# Inlined by force: a call could end in another copy, with sums in another order (docs/decisions/0013).
@nb.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
def sum_wall(a, side, buf, area, n, k, reaction):
    """Sum the wall terms of one particle over the first ``n`` entries of a buffer of elements.

    Parameters
    ----------
    a : tuple of 8 floats
        x, y, z, vx, vy, vz, density above rest, pressure of the particle.
    side : float
        Its signed distance from the wall; zero where that is unknown.
    buf : ndarray, shape (11, m)
        Elements, rows as packed.
    area : ndarray, shape (m,)
        Area of each element, zero where hidden by another wall.
    n : int
        Number of entries to use.
    k : ndarray, shape (32,)
        Wall constants.
    reaction : ndarray, shape (4, m), or None
        Per mass of the particle: receives its reaction on every element (3) [m/s2] and the part of the
        element's normal reaction that is proportional to its deceleration, the air it carries along [1].

    Returns
    -------
    tuple of 12 floats
        Pressure acceleration (3), viscous acceleration (3) [m/s2], rate of relative density [1/s], shifting
        (3) [1/m], and the power per mass of the two accelerations on the moving wall [m2/s3].
    """
    long_vectors()
    xa, ya, za, ua, va, wa, da, pa = a
    half_over_h, one, two, four, zero = k[HALF_OVER_H], k[ONE], k[TWO], k[FOUR], k[ZERO]
    nearest_inverse = one / k[NEAREST]
    g0_factor, g1_factor, c_factor = k[G0_FACTOR], k[G1_FACTOR], k[C_FACTOR]
    sound, approach, tiny, three_d = k[SOUND], k[APPROACH], k[TINY], k[THREE_D]
    half_space, diffusion = k[HALF_SPACE], k[DIFFUSION]
    rho = k[RHO0] + da
    over_rho = one / rho
    a0, a1, a2, a3 = k[COEFFICIENTS], k[COEFFICIENTS + 1], k[COEFFICIENTS + 2], k[COEFFICIENTS + 3]
    b0, b1, b2, b3, b4 = (
        k[COEFFICIENTS + 5],
        k[COEFFICIENTS + 6],
        k[COEFFICIENTS + 7],
        k[COEFFICIENTS + 8],
        k[COEFFICIENTS + 9],
    )
    c0, c1, c2 = k[COEFFICIENTS + 10], k[COEFFICIENTS + 11], k[COEFFICIENTS + 12]
    x, y, z = buf[EX][:n], buf[EY][:n], buf[EZ][:n]
    u, v, w = buf[EVX][:n], buf[EVY][:n], buf[EVZ][:n]
    normal_x, normal_y, normal_z = buf[NX][:n], buf[NY][:n], buf[NZ][:n]
    acceleration, area = buf[NORMAL_ACCELERATION][:n], area[:n]
    if reaction is not None:
        # As slices, because indices that may be negative keep the loop from using vectors.
        reaction_x, reaction_y = reaction[0][:n], reaction[1][:n]
        reaction_z, carried = reaction[2][:n], reaction[3][:n]
    px = py = pz = fx = fy = fz = div = sx = sy = sz = pp = pf = zero
    for j in range(n):
        dx, dy, dz = xa - x[j], ya - y[j], za - z[j]
        r = np.sqrt(dx * dx + dy * dy + dz * dz) + tiny
        inverse = one / r
        t = max(one - r * half_over_h, zero)
        t4 = t * t
        t4 = t4 * t4
        g0 = g0_factor * t4 * (a0 + t * (a1 + t * (a2 + t * a3)))
        g1 = g1_factor * t4 * (b0 + t * (b1 + t * (b2 + t * (b3 + t * b4))))
        c = c_factor * t4 * (c0 + t * (c1 + t * c2))
        near = min(inverse, nearest_inverse)
        ex, ey, ez = dx * inverse, dy * inverse, dz * inverse
        ne = normal_x[j] * ex + normal_y[j] * ey + normal_z[j] * ez
        omega = min(abs(ne) * area[j] * inverse * (three_d * inverse + (one - three_d)), half_space)
        omega = omega if ne * side >= zero else zero
        du, dv, dw = ua - u[j], va - v[j], wa - w[j]
        away = du * ex + dv * ey + dw * ez
        div += omega * (away * max(g1 * near, four * g0) - diffusion * acceleration[j] * ne * g0)
        speed = max(
            -(du * normal_x[j] + dv * normal_y[j] + dw * normal_z[j]) * (one if ne > zero else -one), zero
        )
        extra = speed * speed * min(approach, sound / (speed + tiny))
        force = -omega * over_rho * ((two * pa + rho * extra) * g0 + rho * acceleration[j] * ne * g1)
        px += force * ex
        py += force * ey
        pz += force * ez
        pp += force * (ex * u[j] + ey * v[j] + ez * w[j])
        drag = k[TWICE_NU] * omega * max(g0 * near, four * c)
        fx += drag * du
        fy += drag * dv
        fz += drag * dw
        pf += drag * (du * u[j] + dv * v[j] + dw * w[j])
        sx += omega * g0 * ex
        sy += omega * g0 * ey
        sz += omega * g0 * ez
        if reaction is not None:
            reaction_x[j] -= force * ex + drag * du
            reaction_y[j] -= force * ey + drag * dv
            reaction_z[j] -= force * ez + drag * dw
            carried[j] -= omega * ne * ne * g1
    return px, py, pz, fx, fy, fz, div, sx, sy, sz, pp, pf
