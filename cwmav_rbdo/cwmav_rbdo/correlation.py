# SPDX-License-Identifier: Apache-2.0
"""Correlation functions R(x, x') of the Gaussian process (Eq. 16 of the paper).

Both depend on the samples only through the squared scaled distance ``s = sum_k ((x_k - x'_k) / l_k)**2``,
so one function of `s` and its slope give the correlation matrix, its gradient in the length scales and its
gradient in x. The conventions are those of scikit-learn's ``RBF`` and ``Matern(nu=2.5)`` with one length
scale per variable.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from cwmav_common.errors import InputError

Array = NDArray[np.float64]


class Correlation(Protocol):
    """A stationary correlation as a function of the squared scaled distance."""

    name: str

    def value(self, s: Array) -> Array:
        """Correlation, 1 at ``s = 0``."""
        ...

    def slope(self, s: Array, value: Array) -> Array:
        """Differentiate with respect to `s`; `value` is the correlation at `s`, already at hand."""
        ...


class Gaussian:
    """Squared exponential, ``exp(-s / 2)``: infinitely smooth responses."""

    name = "gaussian"

    def value(self, s: Array) -> Array:
        """Correlation, 1 at ``s = 0``."""
        value = np.multiply(s, -0.5)
        return np.exp(value, out=value)

    def slope(self, s: Array, value: Array) -> Array:
        """Differentiate with respect to `s`."""
        return -0.5 * value


class Matern52:
    """Matern with nu = 5/2: twice differentiable responses (Rasmussen and Williams 2006, Eq. 4.17)."""

    name = "matern52"

    def value(self, s: Array) -> Array:
        """Correlation, 1 at ``s = 0``."""
        t = np.sqrt(5.0 * s)
        return (1.0 + t + (5.0 / 3.0) * s) * np.exp(-t)

    def slope(self, s: Array, value: Array) -> Array:
        """Differentiate with respect to `s`; finite at ``s = 0``."""
        t = np.sqrt(5.0 * s)
        return (-5.0 / 6.0) * (1.0 + t) * np.exp(-t)


CORRELATIONS: Mapping[str, Correlation] = {"gaussian": Gaussian(), "matern52": Matern52()}


def correlation(name: str) -> Correlation:
    """Look a correlation up by name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    try:
        return CORRELATIONS[name]
    except KeyError:
        allowed = ", ".join(CORRELATIONS)
        raise InputError(f"kernel = {name!r}: allowed are {allowed}") from None


def squared_distance(A: Array, B: Array, length_scale: Array) -> Array:
    """Squared scaled distances between two sets of points, from exact differences.

    The shorter way by a matrix product loses digits to cancellation, which an ill-conditioned correlation
    matrix multiplies; up to ten variables it is no faster.

    Parameters
    ----------
    A : (m, d) array
    B : (n, d) array
    length_scale : (d,) array

    Returns
    -------
    (m, n) array
    """
    return np.asarray(cdist(A / length_scale, B / length_scale, "sqeuclidean"), dtype=np.float64)
