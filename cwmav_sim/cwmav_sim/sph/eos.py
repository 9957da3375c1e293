# SPDX-License-Identifier: Apache-2.0
"""Tait equation of state of the weakly compressible gas.

    p = B ((rho/rho0)^gamma - 1) + p_b,   B = rho0 c0^2 / gamma

(J. J. Monaghan, J. Comput. Phys. 110 (1994) 399); the background pressure p_b acts only through the particle
disorder and keeps low-pressure regions from opening into voids.
"""

from __future__ import annotations

from dataclasses import dataclass

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
        return np.asarray(
            self.stiffness * ((rho / self.density) ** self.gamma - 1.0) + self.background, dtype=np.float64
        )
