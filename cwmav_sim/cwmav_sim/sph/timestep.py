# SPDX-License-Identifier: Apache-2.0
"""Time step: dt = min( C sqrt(h / |a|max), C h / c, h^2 / (8 nu) ), c the fastest signal.

(J. J. Monaghan, A. Kos, J. Waterw. Port Coast. Ocean Eng. 125 (1999) 145, without the viscous rate of pairs;
the diffusive limit is that of J. P. Morris et al., J. Comput. Phys. 136 (1997) 214, and never rules in air.)
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

_PARTS = 64  # that a search is cut into


def largest_length(vectors: NDArray[np.float64]) -> float:
    """Return the length of the longest of ``vectors``, shape (n, 3); NaN if any is undefined."""
    return math.sqrt(float(np.max(_largest_squares(vectors), initial=0.0)))


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _largest_squares(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    n = len(vectors)
    out = np.zeros(_PARTS)
    for part in nb.prange(_PARTS):
        most, undefined = 0.0, False
        for i in range(part * n // _PARTS, (part + 1) * n // _PARTS):
            square = vectors[i, 0] ** 2 + vectors[i, 1] ** 2 + vectors[i, 2] ** 2
            most = max(most, square)
            undefined |= np.isnan(square)
        out[part] = np.nan if undefined else most
    return out


def stable_step(
    cfl: float, h: float, signal_speed: float, acceleration: float, viscosity: float = 0.0
) -> float:
    """Return the largest stable time step [s].

    Parameters
    ----------
    cfl, h : float
        Courant number and smoothing length [m].
    signal_speed, acceleration, viscosity : float
        Highest signal speed [m/s], largest acceleration [m/s2], kinematic viscosity [m2/s].
    """
    acoustic = h / signal_speed
    inertial = math.sqrt(h / acceleration) if acceleration > 0.0 else math.inf
    diffusive = 0.125 * h**2 / viscosity if viscosity > 0.0 else math.inf
    return min(cfl * min(acoustic, inertial), diffusive)
