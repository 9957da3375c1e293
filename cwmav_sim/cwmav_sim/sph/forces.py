# SPDX-License-Identifier: Apache-2.0
"""The pass over all particles of air without walls: fluid sums, rates of change.

Work is done patch by patch of cells (see ``patches``). ``walled`` does the same among walls.
"""

from __future__ import annotations

import numba as nb

from cwmav_sim.sph.gather import ANY_IMAGE, fill
from cwmav_sim.sph.lending import held, lent
from cwmav_sim.sph.nearby import box_around, keep_nearby, space
from cwmav_sim.sph.pair import FLUID_ROWS, HALF_OVER_H, ONE, VOLUME, WORK_ROWS, sum_pairs
from cwmav_sim.sph.patches import CHUNKS, cell_of, cells_in, dealt, patch_of, share
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode

FLUID = 2, 3  # vectors and scalars among the rows of the packed fluid

# Places in the array of scale factors.
SLOPE, FOUR_NU, DIFFUSION, RHO0, MASS = range(5)

# Places in a wall load: pressure force, viscous force, power of the two on the moving wall, moment.
LOAD_SIZE = 11


@nb.njit(cache=True, error_model="numpy")
def read_particle(fluid, offset, i):
    """Return a particle whose cell lies ``offset`` [m] along y and z from the centre of its patch."""
    y, z = fluid[1, i] + offset[0], fluid[2, i] + offset[1]
    return (fluid[0, i], y, z, fluid[3, i], fluid[4, i], fluid[5, i], fluid[6, i], fluid[7, i])


@nb.njit(cache=True, error_model="numpy")
def own_factors(scale, density, keep_diffusion, k):
    """Return the factors of diffusion and viscosity of a particle, in the precision of the pairs ``k``."""
    rho = scale[RHO0] + density
    diffusion = scale[DIFFUSION] / rho if keep_diffusion else 0.0
    return k.dtype.type(diffusion), k.dtype.type(scale[FOUR_NU] * rho)


@nb.njit(cache=True, error_model="numpy")
def store_rates(sums, scale, density, place, acceleration, density_rate, shift):
    """Turn the fluid sums of a particle into rates of change (float64)."""
    rho = scale[RHO0] + density
    slope = scale[SLOPE]
    for q in range(3):
        acceleration[place, q] = -slope / rho * sums[1 + q]
        shift[place, q] = slope * sums[4 + q]
    density_rate[place] = slope * rho * sums[0]


@nb.njit(cache=True, error_model="numpy")
def support2(k):
    """Return the square of the radius of the support [m2], in the precision of the pairs."""
    radius = k[ONE] / k[HALF_OVER_H]
    return radius * radius


@nb.njit(cache=True, parallel=True, error_model="numpy")
def fluid_pass(
    fluid,
    column,
    order,
    start,
    integers,
    cell,
    k,
    scale,
    shifting,
    room,
    orders,
    acceleration,
    density_rate,
    shift,
):
    """Rates of change of particles that see no wall anywhere.

    Parameters
    ----------
    fluid : ndarray, shape (9, n)
        Packed particles in cell order.
    column, order, start, integers, cell : ndarray
        Their columns and numbers, first place of every cell, grid integers and cell extent.
    k, scale : ndarray
        Pair constants and scale factors.
    shifting : bool
        Whether the shifting vector is wanted.
    room : int
        Length of the largest buffer.
    orders : ndarray
        From :func:`~cwmav_sim.sph.blocks.lane_orders`.
    acceleration, density_rate, shift : ndarray, shape (n, 3), (n,) and (n, 3), float64
        Filled, under the numbers of the particles; the last is the shifting vector [1/m], zero when it is
        not wanted.
    """
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        own_space = space(FLUID_ROWS, WORK_ROWS, room, fluid)
        buf, begin, runs, nearby, kept, work = lent(own_space)
        reach2 = support2(k)
        for turn in range(share(integers)):
            number = dealt(integers, chunk, turn)
            if number < 0:
                continue
            patch = patch_of(integers, number)
            fill((fluid, column, start), FLUID, ANY_IMAGE, integers, cell, patch, runs, buf, begin)
            for member in range(cells_in(patch)):
                c, window, offset = cell_of(patch, member, integers, cell)
                if start[c + 1] == start[c]:
                    continue
                box = box_around(fluid, start[c], start[c + 1], offset)
                n, _ = keep_nearby(buf, FLUID_ROWS, begin, patch, window, box, reach2, orders, nearby, kept)
                for i in range(start[c], start[c + 1]):
                    a = read_particle(fluid, offset, i)
                    own = own_factors(scale, a[6], True, k)
                    sums = sum_pairs(a, own, nearby, nearby[VOLUME], n, k, shifting, work)
                    store_rates(sums, scale, a[6], order[i], acceleration, density_rate, shift)
        held(own_space)
        restore_mode(mode)
