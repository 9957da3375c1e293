# SPDX-License-Identifier: Apache-2.0
"""Quintic Wendland kernel with support 2h, its gradient and its ray integrals.

With q = r/h and t = max(1 - q/2, 0):

    W = A t^4 (2q + 1),        grad W = F r,   F = -(5 A / h^2) t^3,
    A = 7 / (4 pi h^2) in two dimensions, 21 / (16 pi h^3) in three.

H. Wendland, Adv. Comput. Math. 4 (1995) 389. The ray integrals J_k(q), of q'^k t(q')^3 from q to 2, give the
part of a kernel sum that lies behind a wall (see ``wall``); in t they are polynomials that vanish at the
edge of the support, so no accuracy is lost there:

    J_k = 2^(k+1) * sum_i C(k, i) (-1)^i t^(4+i) / (4+i).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """Kernel constants for one smoothing length.

    Attributes
    ----------
    h : float
        Smoothing length [m]; the support is 2h.
    dimensions : int
        2 or 3.
    """

    h: float
    dimensions: int

    @property
    def amplitude(self) -> float:
        """Factor A of the kernel [1/m^d]."""
        if self.dimensions == 2:
            return 7.0 / (4.0 * math.pi * self.h**2)
        return 21.0 / (16.0 * math.pi * self.h**3)

    @property
    def slope(self) -> float:
        """Factor of t^3 in F [1/m^(d+2)]; negative."""
        return -5.0 * self.amplitude / self.h**2

    def value(self, r: FloatArray | float) -> FloatArray:
        """Return W [1/m^d] at distances ``r`` [m]."""
        q = np.asarray(r, dtype=np.float64) / self.h
        t = np.maximum(1.0 - 0.5 * q, 0.0)
        return np.asarray(self.amplitude * t**4 * (2.0 * q + 1.0))

    def gradient_over_r(self, r: FloatArray | float) -> FloatArray:
        """Return F [1/m^(d+2)], with grad W = F r, at distances ``r`` [m]."""
        t = np.maximum(1.0 - 0.5 * np.asarray(r, dtype=np.float64) / self.h, 0.0)
        return np.asarray(self.slope * t**3)


def ray_integral_coefficients(k: int) -> FloatArray:
    """Return the factors c_i of J_k = t^4 sum_i c_i t^i, shape (k + 1,)."""
    i = np.arange(k + 1)
    binomial = np.array([math.comb(k, int(j)) for j in i], dtype=np.float64)
    return np.asarray(2.0 ** (k + 1) * binomial * (-1.0) ** i / (4.0 + i))


def ray_integral(k: int, q: FloatArray | float) -> FloatArray:
    """Return J_k(q), the integral of q'^k (1 - q'/2)^3 from q to 2."""
    t = np.maximum(1.0 - 0.5 * np.asarray(q, dtype=np.float64), 0.0)
    return np.asarray(t**4 * np.polynomial.polynomial.polyval(t, ray_integral_coefficients(k)))
