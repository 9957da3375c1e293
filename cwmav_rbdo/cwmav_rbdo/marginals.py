# SPDX-License-Identifier: Apache-2.0
"""Distributions that problem files name, and the Gaussian copula that joins them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from cwmav_common.errors import InputError

Array = NDArray[np.float64]
DISTRIBUTIONS = ("normal", "lognormal", "uniform", "gumbel")
_EULER = 0.5772156649015329


def transformed(dist: str, name: str, mean: Array, std: Array, z: Array) -> Array:
    """Map standard normal values to a distribution of given mean and standard deviation.

    Parameters
    ----------
    dist : one of `DISTRIBUTIONS`; gumbel is that of largest values
    name : of the variable, for the message
    mean, std, z : (n,) arrays

    Raises
    ------
    InputError
        A lognormal variable has a mean that is not positive.
    """
    if dist == "normal":
        return mean + std * z
    if dist == "lognormal":
        if np.any(mean <= 0.0):
            raise InputError(f"random variable {name}: a lognormal mean must be > 0, got {mean.min():g}")
        zeta2 = np.log1p((std / mean) ** 2)
        return np.asarray(np.exp(np.log(mean) - 0.5 * zeta2 + np.sqrt(zeta2) * z))
    if dist == "uniform":
        return np.asarray(mean + np.sqrt(3.0) * std * (2.0 * ndtr(z) - 1.0))
    scale = std * np.sqrt(6.0) / np.pi
    return np.asarray(mean - _EULER * scale - scale * np.log(-np.log(np.clip(ndtr(z), 1e-300, 1.0 - 1e-16))))


def copula_factor(names: Sequence[str], corr: Sequence[tuple[str, str, float]]) -> Array | None:
    """Cholesky factor of the correlation of the underlying normal variables; None where there is none.

    Raises
    ------
    InputError
        A pair names an unknown variable or is given twice, or the correlations contradict each other.
    """
    if not corr:
        return None
    C = np.eye(len(names))
    for a, b, rho in corr:
        if a not in names or b not in names or a == b or not -1.0 < rho < 1.0:
            raise InputError(
                f"corr [{a}, {b}, {rho}]: expected two different random variables of "
                f"{', '.join(names)} and a correlation above -1 and below 1"
            )
        j, k = names.index(a), names.index(b)
        if C[j, k] != 0.0:
            raise InputError(f"corr [{a}, {b}, {rho}]: the correlation of the two is given twice")
        C[j, k] = C[k, j] = rho
    try:
        return np.asarray(np.linalg.cholesky(C))
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(C)[0]
        raise InputError(
            f"corr: the correlations contradict each other, or leave a variable no freedom of its own (least "
            f"eigenvalue {least:.3g}; it has to be above 0)"
        ) from None
