# SPDX-License-Identifier: Apache-2.0
"""Predictor-corrector step in time, second order, with the density update that keeps it positive.

    predictor   x* = x + v dt/2,  v* = v + a dt/2,  rho* = rho + D dt/2
    corrector   v' = v + a* dt,   x' = x + (v + v') dt/2,
                rho' = rho (2 - e) / (2 + e),  e = -D* dt / rho*

with the rates a, D at the begin and a*, D* at the predicted state (A. N. Parshikov et al., Int. J. Impact
Eng. 24 (2000) 779, as used by J. M. Dominguez et al., Comput. Part. Mech. 9 (2022) 867).
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.rates import Rates
from cwmav_sim.sph.state import Particles

FloatArray = NDArray[np.float64]


def predict(start: Particles, rates: Rates, dt: float) -> Particles:
    """Return the particles half a step of ``dt`` [s] ahead."""
    out = _room(start)
    _predict(start.x, start.v, start.rho, rates.acceleration, rates.density_rate, dt, out.x, out.v, out.rho)
    return out


def correct(start: Particles, predicted: Particles, rates: Rates, dt: float) -> Particles:
    """Return the particles a whole step ahead, from the rates of the predicted ones."""
    out = _room(start)
    _correct(
        start.x,
        start.v,
        start.rho,
        predicted.rho,
        rates.acceleration,
        rates.density_rate,
        dt,
        out.x,
        out.v,
        out.rho,
    )
    return out


def _room(like: Particles) -> Particles:
    return Particles(
        np.empty_like(like.x), np.empty_like(like.v), np.empty_like(like.rho), like.mass, like.identity
    )


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _predict(
    x: FloatArray,
    v: FloatArray,
    rho: FloatArray,
    acceleration: FloatArray,
    density_rate: FloatArray,
    dt: float,
    x_out: FloatArray,
    v_out: FloatArray,
    rho_out: FloatArray,
) -> None:
    half = 0.5 * dt
    for i in nb.prange(len(rho)):
        for q in range(3):
            x_out[i, q] = x[i, q] + half * v[i, q]
            v_out[i, q] = v[i, q] + half * acceleration[i, q]
        rho_out[i] = rho[i] + half * density_rate[i]


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _correct(
    x: FloatArray,
    v: FloatArray,
    rho: FloatArray,
    rho_middle: FloatArray,
    acceleration: FloatArray,
    density_rate: FloatArray,
    dt: float,
    x_out: FloatArray,
    v_out: FloatArray,
    rho_out: FloatArray,
) -> None:
    for i in nb.prange(len(rho)):
        for q in range(3):
            v_out[i, q] = v[i, q] + dt * acceleration[i, q]
            x_out[i, q] = x[i, q] + 0.5 * dt * (v[i, q] + v_out[i, q])
        e = -density_rate[i] * dt / rho_middle[i]
        rho_out[i] = rho[i] * (2.0 - e) / (2.0 + e)
