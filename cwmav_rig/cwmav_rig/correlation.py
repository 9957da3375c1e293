# SPDX-License-Identifier: Apache-2.0
"""Correlation between the quantities from cycle to cycle, and how well it is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAGS = 60  # cycles over which a memory is followed
LEAST = 16  # cycles below which nothing is said


@dataclass(frozen=True)
class Correlations:
    """Pearson correlations of the cycle values.

    Attributes
    ----------
    names
        k quantities.
    matrix
        (k, k) correlation coefficients.
    std
        (k, k) standard uncertainty of a coefficient that is truly zero: what memory leaves of the cycles.
    """

    names: tuple[str, ...]
    matrix: Array
    std: Array

    def to_json(self) -> dict[str, Any]:
        """Give names, matrix and uncertainty as plain values."""
        return {"variables": list(self.names), "matrix": self.matrix.tolist(), "std": self.std.tolist()}


def correlations(values: Mapping[str, Array]) -> Correlations | None:
    """Correlate quantities given per cycle, (m,) each, NaN where a cycle cannot be used.

    Notes
    -----
    With the autocorrelations a, b of two quantities that have nothing to do with each other, their sample
    correlation over n values has the variance ``(1 + 2 sum a_k b_k) / n`` (Bartlett 1946). The sums stop at
    the first negative product, beyond which there is only noise.
    """
    names = tuple(name for name, found in values.items() if np.isfinite(found).sum() >= LEAST)
    if len(names) < 2:
        return None
    standard = {name: _standardised(values[name]) for name in names}
    k = len(names)
    matrix, std = np.eye(k), np.zeros((k, k))
    for i in range(k):
        for j in range(i):
            a, b = standard[names[i]], standard[names[j]]
            both = np.isfinite(a) & np.isfinite(b)
            if both.sum() < LEAST or not a[both].std() * b[both].std() > 0.0:
                matrix[i, j] = matrix[j, i] = std[i, j] = std[j, i] = np.nan
                continue
            matrix[i, j] = matrix[j, i] = float(np.corrcoef(a[both], b[both])[0, 1])
            std[i, j] = std[j, i] = float(np.sqrt(_memory(a, b) / both.sum()))
    return Correlations(names, matrix, std)


def _standardised(values: Array) -> Array:
    known = np.isfinite(values)
    spread = float(values[known].std())
    return (values - values[known].mean()) / spread if spread > 0.0 else values * 0.0


def _memory(a: Array, b: Array) -> float:
    total = 1.0
    for lag in range(1, min(LAGS, len(a) // 4) + 1):
        product = _autocorrelation(a, lag) * _autocorrelation(b, lag)
        if not product > 0.0:
            break
        total += 2.0 * product
    return total


def _autocorrelation(values: Array, lag: int) -> float:
    products = values[:-lag] * values[lag:]
    known = np.isfinite(products)
    return float(products[known].mean()) if known.any() else 0.0
