# SPDX-License-Identifier: Apache-2.0
"""Predictor-corrector step in time, second order, with the density update that keeps it positive.

    predictor   x* = x + v dt/2,  v* = v + a dt/2,  rho* = rho + D dt/2
    corrector   v' = v + a* dt,   x' = x + (v + v') dt/2,
                rho' = rho (2 - e) / (2 + e),  e = -D* dt / rho*

with the rates a, D at the begin and a*, D* at the predicted state (A. N. Parshikov et al., Int. J. Impact
Eng. 24 (2000) 779, as used by J. M. Dominguez et al., Comput. Part. Mech. 9 (2022) 867).
"""

from __future__ import annotations

from cwmav_sim.sph.rates import Rates
from cwmav_sim.sph.state import Particles


def predict(start: Particles, rates: Rates, dt: float) -> Particles:
    """Return the particles half a step of ``dt`` [s] ahead."""
    half = 0.5 * dt
    return Particles(
        start.x + half * start.v,
        start.v + half * rates.acceleration,
        start.rho + half * rates.density_rate,
        start.mass,
        start.identity,
    )


def correct(start: Particles, predicted: Particles, rates: Rates, dt: float) -> Particles:
    """Return the particles a whole step ahead, from the rates of the predicted ones."""
    v = start.v + dt * rates.acceleration
    e = -rates.density_rate * dt / predicted.rho
    return Particles(
        start.x + 0.5 * dt * (start.v + v),
        v,
        start.rho * (2.0 - e) / (2.0 + e),
        start.mass,
        start.identity,
    )
