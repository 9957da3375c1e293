# SPDX-License-Identifier: Apache-2.0
"""Stress of the eddies smaller than a particle: Smagorinsky's model in particle form.

    S      = symmetric part of  - sum V_b (v_a - v_b) (x) grad W,     |S| = sqrt(2 S : S)
    nu_t   = (C_s L)^2 |S|,   L = dp / sqrt(d),   C_s = 0.12,   C_I = 0.0066
    tau/rho = 2 nu_t S - (2/3) nu_t tr(S) 1 - (2/3) C_I L^2 |S|^2 1
    dv_a/dt += sum m_b (tau_a/rho_a^2 + tau_b/rho_b^2) . grad W

over the air that is not hidden by a wall; walls themselves carry no such stress (H. Gotoh et al., Coast. Eng.
J. 43 (2001) 39; R. A. Dalrymple, B. D. Rogers, Coast. Eng. 53 (2006) 141). Pair forces cancel.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.around import keep_sides, side_space
from cwmav_sim.sph.blocks import long_vectors
from cwmav_sim.sph.gather import ANY_IMAGE, fill
from cwmav_sim.sph.lending import held, lent
from cwmav_sim.sph.nearby import box_around, keep_nearby, space
from cwmav_sim.sph.patches import CHUNKS, cell_of, cells_in, dealt, marked_slabs, patch_of, share
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode
from cwmav_sim.sph.visibility import gather_sides, hide

SMAGORINSKY, ISOTROPIC = 0.12, 0.0066

# Rows: position; velocity or (xx, xy, yy); (zz, yz, xz); weight. In a mirror the y parts of vectors change
# sign, and so do xy and yz.
_LAYOUT = 3, 1  # vectors and scalars among the rows
_ROWS, _WEIGHT = 10, 9

# Places of the constants.
_HALF_OVER_H, _SLOPE, _LENGTH2, _RHO0 = range(4)


def constants(h: float, slope: float, dp: float, rho0: float, dimensions: int) -> NDArray[np.float64]:
    """Return the constants of the passes, shape (4,)."""
    return np.array([0.5 / h, slope, dp**2 / dimensions, rho0])


def add_subgrid_stress(
    acceleration: NDArray[np.float64],
    fluid: NDArray,
    column: NDArray,
    order: NDArray[np.int64],
    start: NDArray[np.int64],
    integers: NDArray[np.int64],
    cell: NDArray,
    mass: float,
    k: NDArray[np.float64],
    signed: NDArray,
    inside: NDArray,
    near: NDArray[np.bool_],
    panels: int,
    room: int,
    orders: NDArray[np.uint64],
) -> None:
    """Add the acceleration by the subgrid stress, shape (n, 3), in place.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
        [m/s2], under the numbers of the particles.
    fluid, column, order, start, integers, cell, signed, inside, near, room, orders
        As in :func:`cwmav_sim.sph.walled.walled_pass`.
    mass : float
        Of a particle [kg].
    k : ndarray, shape (4,)
        From :func:`constants`.
    panels : int
        Number of walls.
    """
    n = fluid.shape[1]
    packed = np.zeros((_ROWS, n), fluid.dtype)
    packed[:6], packed[_WEIGHT] = fluid[:6], fluid[8]
    stress = np.empty((n, 6))
    common = (column, start, integers, cell, k, signed, inside, near, panels, room, orders)
    _pass(packed, fluid[6], *common, False, stress)
    packed[3:9] = stress.T
    packed[_WEIGHT] = mass
    found = np.empty((n, 6))
    _pass(packed, fluid[6], *common, True, found)
    acceleration[order] += found[:, :3]


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _pass(
    packed,
    density,
    column,
    start,
    integers,
    cell,
    k,
    signed,
    inside,
    near,
    panels,
    room,
    orders,
    of_stress,
    out,
):
    channels = signed.shape[0]
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        own_space = (
            space(_ROWS, 1, room, packed),
            (side_space(channels, room, packed), side_space(channels, room, packed)),
        )
        (buf, begin, runs, nearby, kept, weight), (sides, nearby_sides) = lent(own_space)
        every = np.ones(channels, np.bool_)
        reach2 = packed.dtype.type(1.0 / (k[_HALF_OVER_H] * k[_HALF_OVER_H]))
        for turn in range(share(integers)):
            number = dealt(integers, chunk, turn)
            if number < 0:
                continue
            patch = patch_of(integers, number)
            fill((packed, column, start), _LAYOUT, ANY_IMAGE, integers, cell, patch, runs, buf, begin)
            slabs = marked_slabs(near, integers, patch)
            gather_sides(signed, inside, begin, patch, runs, slabs, panels, every, sides.signed, sides.inside)
            for member in range(cells_in(patch)):
                c, window, offset = cell_of(patch, member, integers, cell)
                if start[c + 1] == start[c]:
                    continue
                box = box_around(packed, start[c], start[c + 1], offset)
                n, looks = keep_nearby(buf, _ROWS, begin, patch, window, box, reach2, orders, nearby, kept)
                walled = near[c]
                if walled:
                    keep_sides(sides, kept, looks, n, orders, every, nearby_sides)
                for i in range(start[c], start[c + 1]):
                    seen = nearby[_WEIGHT]
                    if walled:
                        s_a, d_a = signed[:, i], inside[:, i]
                        near_s, near_d, below, above = nearby_sides
                        seen = hide(seen, s_a, d_a, near_s, near_d, below, above, n, weight[0])
                    if of_stress:
                        _divergence(packed, offset, i, nearby, seen, n, k, out)
                    else:
                        _stress(packed, offset, i, k[_RHO0] + density[i], nearby, seen, n, k, out)
        held(own_space)
        restore_mode(mode)


@nb.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
def _stress(packed, offset, i, rho, buf, weight, n, k, out):
    """Tensor tau/rho^2 of one particle: (xx, xy, yy, zz, yz, xz)."""
    long_vectors()
    xa, ya, za = packed[0, i], packed[1, i] + offset[0], packed[2, i] + offset[1]
    ua, va, wa = packed[3, i], packed[4, i], packed[5, i]
    xx = xy = yy = zz = yz = xz = 0.0
    for j in range(n):
        dx, dy, dz = xa - buf[0, j], ya - buf[1, j], za - buf[2, j]
        t = max(1.0 - np.sqrt(dx * dx + dy * dy + dz * dz) * k[_HALF_OVER_H], 0.0)
        f = -k[_SLOPE] * t * t * t * weight[j]
        du, dv, dw = (ua - buf[3, j]) * f, (va - buf[4, j]) * f, (wa - buf[5, j]) * f
        xx += du * dx
        yy += dv * dy
        zz += dw * dz
        xy += 0.5 * (du * dy + dv * dx)
        yz += 0.5 * (dv * dz + dw * dy)
        xz += 0.5 * (du * dz + dw * dx)
    square = 2.0 * (xx * xx + yy * yy + zz * zz) + 4.0 * (xy * xy + yz * yz + xz * xz)
    eddy = SMAGORINSKY * SMAGORINSKY * k[_LENGTH2] * np.sqrt(square)
    even = (2.0 * eddy * (xx + yy + zz) + 2.0 * ISOTROPIC * k[_LENGTH2] * square) / 3.0
    out[i, 0], out[i, 2], out[i, 3] = (
        (2.0 * eddy * xx - even) / rho,
        (2.0 * eddy * yy - even) / rho,
        (2.0 * eddy * zz - even) / rho,
    )
    out[i, 1], out[i, 4], out[i, 5] = 2.0 * eddy * xy / rho, 2.0 * eddy * yz / rho, 2.0 * eddy * xz / rho


@nb.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
def _divergence(packed, offset, i, buf, weight, n, k, out):
    """Acceleration of one particle by the stresses of the pairs."""
    long_vectors()
    xa, ya, za = packed[0, i], packed[1, i] + offset[0], packed[2, i] + offset[1]
    ax = ay = az = 0.0
    for j in range(n):
        dx, dy, dz = xa - buf[0, j], ya - buf[1, j], za - buf[2, j]
        t = max(1.0 - np.sqrt(dx * dx + dy * dy + dz * dz) * k[_HALF_OVER_H], 0.0)
        f = k[_SLOPE] * t * t * t * weight[j]
        xx, xy, yy = packed[3, i] + buf[3, j], packed[4, i] + buf[4, j], packed[5, i] + buf[5, j]
        zz, yz, xz = packed[6, i] + buf[6, j], packed[7, i] + buf[7, j], packed[8, i] + buf[8, j]
        ax += f * (xx * dx + xy * dy + xz * dz)
        ay += f * (xy * dx + yy * dy + yz * dz)
        az += f * (xz * dx + yz * dy + zz * dz)
    out[i, 0], out[i, 1], out[i, 2] = ax, ay, az
