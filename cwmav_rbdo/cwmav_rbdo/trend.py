# SPDX-License-Identifier: Apache-2.0
"""Regression functions h(x) of the Kriging trend (Eq. 15 of the paper): constant, linear, quadratic."""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError

Array = NDArray[np.float64]
TRENDS = ("constant", "linear", "quadratic")


@cache
def terms(trend: str, dimension: int) -> tuple[tuple[int, ...], ...]:
    """Monomials of the trend, each as the tuple of variables multiplied: ``()``, ``(k,)`` or ``(k, l)``.

    Raises
    ------
    InputError
        If there is no trend of that name.
    """
    if trend not in TRENDS:
        raise InputError(f"trend = {trend!r}: allowed are {', '.join(TRENDS)}, auto")
    order = TRENDS.index(trend)
    return tuple(
        term
        for degree in range(order + 1)
        for term in combinations_with_replacement(range(dimension), degree)
    )


def basis(trend: str, X: Array) -> Array:
    """Evaluate h at every row of X (m, d); returns (m, p)."""
    columns = terms(trend, X.shape[1])
    H = np.ones((len(X), len(columns)))
    for column, term in enumerate(columns):
        for k in term:
            H[:, column] *= X[:, k]
    return H


def basis_gradient(trend: str, X: Array) -> Array:
    """Differentiate h at every row of X (m, d); returns (m, p, d)."""
    columns = terms(trend, X.shape[1])
    dH = np.zeros((len(X), len(columns), X.shape[1]))
    for column, term in enumerate(columns):
        for position, k in enumerate(term):
            others = term[:position] + term[position + 1 :]
            dH[:, column, k] += np.prod(X[:, others], axis=1) if others else 1.0
    return dH
