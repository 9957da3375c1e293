# SPDX-License-Identifier: Apache-2.0
"""Small corrections of the positions alone: shifting in the open, keeping a distance at the walls.

Shifting moves particles down the gradient of their concentration,

    dx = - C h U dt grad(concentration),   clipped to a fraction of the spacing

(S. J. Lind et al., J. Comput. Phys. 231 (2012) 1499, with the speed U of the flow for the time scale). Within
one spacing of a wall its part towards the wall is dropped. The wall sums are almost flat between a particle
on the wall and one half a spacing away, so nothing in them restores the gap: particles nearer than the
keep-out distance are eased away by a tenth of what is missing, every step.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.rates import Rates
from cwmav_sim.sph.settings import FlowSettings

FloatArray = NDArray[np.float64]

EASE = 0.1  # share of the missing distance made good in a step


def ease(x: FloatArray, rates: Rates, settings: FlowSettings, h: float, speed: float, dt: float) -> None:
    """Correct the positions ``x`` [m], shape (n, 3), in place.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions [m].
    rates : Rates
        Of the same particles: concentration gradient and sides.
    settings : FlowSettings
        Shifting and keep-out.
    h, speed, dt : float
        Smoothing length [m], speed of the flow [m/s], time step [s].
    """
    dp = settings.resolution.dp
    _ease(
        x,
        rates.concentration_gradient,
        rates.sides.signed,
        rates.sides.inside,
        rates.sides.normal,
        settings.shifting.coefficient * h * speed * dt,
        settings.shifting.limit * dp,
        dp,
        settings.sheet.keep_out * dp,
    )


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _ease(
    x: FloatArray,
    gradient: FloatArray,
    signed: NDArray,
    inside: NDArray,
    normal: NDArray,
    strength: float,
    limit: float,
    dp: float,
    keep_out: float,
) -> None:
    for i in nb.prange(x.shape[0]):
        mx, my, mz = -strength * gradient[i, 0], -strength * gradient[i, 1], -strength * gradient[i, 2]
        length = np.sqrt(mx**2 + my**2 + mz**2)
        if length > limit:
            cut = limit / length
            mx, my, mz = cut * mx, cut * my, cut * mz
        for c in range(signed.shape[0]):
            s = signed[c, i]
            distance = abs(s)
            if s == 0.0 or distance >= dp or inside[c, i] <= 0.0:
                continue
            side = 1.0 if s > 0.0 else -1.0
            nx, ny, nz = side * normal[c, 0, i], side * normal[c, 1, i], side * normal[c, 2, i]
            away = mx * nx + my * ny + mz * nz
            correction = max(-away, 0.0) + EASE * max(keep_out - distance, 0.0)
            mx, my, mz = mx + correction * nx, my + correction * ny, mz + correction * nz
        x[i, 0] += mx
        x[i, 1] += my
        x[i, 2] += mz
