# SPDX-License-Identifier: Apache-2.0
"""Fringe zone at the downstream end of the periodic box: it gives the air back the state of the stream.

Velocity relaxes to the stream and density to rho0 at a rate that rises smoothly from zero at both ends of the
zone (sin^2); a second zone may straddle the faces across z, and the larger rate counts. The relaxation is
integrated exactly over a step (J. Nordstrom, N. Nordin, D. Henningson, SIAM J. Sci. Comput. 20 (1999) 1365).
Particles thus need neither creation nor removal.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PARTS = 64  # that the sum is cut into, whatever the number of threads


@nb.njit(cache=True)
def _shape(share: float) -> float:
    return math.sin(math.pi * share) ** 2 if 0.0 < share < 1.0 else 0.0


@nb.njit(cache=True, parallel=True, error_model="numpy")
def relax(
    x: FloatArray,
    v: FloatArray,
    rho: FloatArray,
    begin: float,
    width: float,
    rate: float,
    stream: FloatArray,
    rho0: float,
    dt: float,
    around: FloatArray,
) -> FloatArray:
    """Relax the particles of the zone over ``dt`` [s], in place.

    Parameters
    ----------
    x, v : ndarray, shape (n, 3)
        Positions [m] and velocities [m/s].
    rho : ndarray, shape (n,)
        Densities [kg/m3].
    begin, width, rate : float
        Where the zone begins in x and how wide it is [m], and its largest rate [1/s].
    stream : ndarray, shape (3,)
        Velocity of the stream [m/s].
    rho0, dt : float
        Density at rest [kg/m3] and time step [s].
    around : ndarray, shape (2,)
        Lower face across z and extent of the box in z [m]; extent zero for no zone there.

    Returns
    -------
    ndarray, shape (64, 4)
        Parts of the sums of the velocity changes [m/s] and of the changes of half the squared speed [m2/s2];
        times the particle mass, the impulse and the work given to the air.
    """
    n, parts = x.shape[0], np.zeros((_PARTS, 4))
    for part in nb.prange(_PARTS):
        for i in range(part * n // _PARTS, (part + 1) * n // _PARTS):
            shape = _shape((x[i, 0] - begin) / width)
            if around[1] > 0.0:
                height = x[i, 2] - around[0] + 0.5 * width
                shape = max(shape, _shape((height - around[1] * math.floor(height / around[1])) / width))
            if shape == 0.0:
                continue
            keep = math.exp(-rate * shape * dt)
            for q in range(3):
                delta = (1.0 - keep) * (stream[q] - v[i, q])
                parts[part, q] += delta
                parts[part, 3] += delta * (v[i, q] + 0.5 * delta)
                v[i, q] += delta
            rho[i] = rho0 + keep * (rho[i] - rho0)
    return parts
