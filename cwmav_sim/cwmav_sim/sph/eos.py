# SPDX-License-Identifier: Apache-2.0
"""Tait equation of state of the weakly compressible gas.

    p = B ((rho/rho0)^gamma - 1) + p_b,   B = rho0 c0^2 / gamma

(J. J. Monaghan, J. Comput. Phys. 110 (1994) 399); the background pressure p_b acts only through the particle
disorder and keeps low-pressure regions from opening into voids.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Tait:
    """Constants of the equation of state: density [kg/m3], sound speed [m/s], pressures [Pa]."""

    density: float
    sound_speed: float
    gamma: float
    background: float

    @property
    def stiffness(self) -> float:
        """Constant B [Pa]."""
        return self.density * self.sound_speed**2 / self.gamma

    def density_at(self, pressure: FloatArray) -> FloatArray:
        """Return the density [kg/m3] at pressures [Pa] without background."""
        return np.asarray(
            self.density * (1.0 + pressure / self.stiffness) ** (1.0 / self.gamma), dtype=np.float64
        )

    def pressure(self, rho: FloatArray) -> FloatArray:
        """Return the pressure [Pa] with background at densities ``rho`` [kg/m3]."""
        rho = np.asarray(rho, dtype=np.float64)
        out = np.empty(rho.shape)
        _pressure(rho.ravel(), self.density, self.stiffness, self.gamma, self.background, out.ravel())
        return out


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _pressure(
    rho: FloatArray, density: float, stiffness: float, gamma: float, background: float, out: FloatArray
) -> None:
    seventh = gamma == 7.0
    for i in nb.prange(len(rho)):
        ratio = rho[i] / density
        if seventh:  # the usual exponent, ten times faster by products
            square = ratio * ratio
            power = square * square * square * ratio
        else:
            power = ratio**gamma
        out[i] = stiffness * (power - 1.0) + background
