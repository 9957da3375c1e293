# SPDX-License-Identifier: Apache-2.0
"""Likelihood of the hyperparameters and its analytic gradient.

The trend coefficients are always concentrated out (Eq. 17). So is the process variance when the responses
are exact; with noise of known variance it does not factor out and becomes one more variable of the search.

All lengths are in units of the scaled samples, so the bounds hold for every problem.

Symmetric matrices are kept as half of their entries, in the rectangular full packed order of LAPACK
(Gustavson, Wasniewski, Dongarra and Langou 2010, ACM Trans. Math. Softw. 37:18): the pairs of samples are
stored in the order in which the factorisation wants the matrix, so nothing is copied and nothing computed
twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.stats import qmc

from cwmav_rbdo.correlation import Correlation
from cwmav_rbdo.universal_kriging import LARGEST_NUGGET

Array = NDArray[np.float64]

LENGTH_BOUNDS = (1e-2, 1e2)
"""Shortest and longest length scale, in units of the range of the samples."""
START_BOUNDS = (2e-2, 5.0)
VARIANCE_BOUNDS = (1e-6, 1e4)
NUGGET_BOUNDS = (1e-12, 1.0)

SCREENING_PER_VARIABLE = 10
_EPSILON = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Hyperparameters:
    """Maximiser of the likelihood."""

    logarithms: Array
    """All of them as the search sees them."""
    length_scale: Array
    process_variance: float | None
    """Only with noise; without it Eq. 17's companion gives it in closed form."""
    nugget: float
    log_likelihood: float


@dataclass(frozen=True)
class _Parts:
    """What one evaluation of the likelihood leaves for its gradient."""

    value: float
    L: Array
    """Cholesky factor of the correlation matrix, packed."""
    residual: Array
    """L^-1 (f - H v)."""
    s: Array
    r: Array
    length: Array
    variance: float
    nugget: float
    relative_noise: Array


class Likelihood:
    """Profile log-likelihood of one data set as a function of the logarithms of the hyperparameters.

    Parameters
    ----------
    correlation : Correlation
    X : (n, d) array
    f : (n,) array
    H : (n, p) array
        Trend regressors.
    noise : (n,) array
        Noise variances; the process variance is searched when any is positive.
    nugget : float or None
        Fixed nugget, or None to search it.
    """

    def __init__(
        self, correlation: Correlation, X: Array, f: Array, H: Array, noise: Array, nugget: float | None
    ) -> None:
        n, d = X.shape
        self.correlation, self.f, self.noise = correlation, f, noise
        self._right = np.asfortranarray(np.column_stack([H, f]))
        self.noisy = bool(np.any(noise > 0.0))
        self.fixed_nugget = nugget
        first, second = _packed_pairs(n)
        self._diagonal = np.flatnonzero(first == second)
        self._diagonal = self._diagonal[np.argsort(first[self._diagonal])]
        self._squared = np.ascontiguousarray(((X[first] - X[second]) ** 2).T)
        self.bounds = [(np.log(LENGTH_BOUNDS[0]), np.log(LENGTH_BOUNDS[1]))] * d
        if self.noisy:
            self.bounds.append((np.log(VARIANCE_BOUNDS[0]), np.log(VARIANCE_BOUNDS[1])))
        if nugget is None:
            self.bounds.append((np.log(NUGGET_BOUNDS[0]), np.log(NUGGET_BOUNDS[1])))
        self.dimension = d

    def unpack(self, p: Array) -> tuple[Array, float, float]:
        """Split the search vector into length scales, process variance (1 when exact) and nugget."""
        values = np.exp(p)
        variance = float(values[self.dimension]) if self.noisy else 1.0
        nugget = float(values[-1]) if self.fixed_nugget is None else self.fixed_nugget
        return values[: self.dimension], variance, nugget

    def restricted(self, terms: int) -> Self:
        """Give the likelihood with only the first regressors of the trend."""
        other = copy(self)
        other._right = np.asfortranarray(np.column_stack([self._right[:, :terms], self.f]))
        return other

    def __call__(self, p: Array) -> tuple[float, Array]:
        """Negative log-likelihood per sample and its gradient."""
        value, gradient, _ = self.evaluate(p)
        return value, gradient

    def evaluate(self, p: Array) -> tuple[float, Array, float]:
        """Negative log-likelihood per sample, its gradient, and the least pivot of the factorisation."""
        parts = self._factor(p)
        if parts is None:
            return 1e10, np.zeros(len(p)), 0.0
        pivot = float(parts.L[self._diagonal].min()) ** 2
        return parts.value, self._gradient(parts) / len(self.f), pivot

    def values(self, p: Array, terms: Sequence[int]) -> Array:
        """Negative log-likelihood per sample with the first regressors alone, for each of their numbers."""
        factored = self._cholesky(p)
        if factored is None:
            return np.full(len(terms), np.inf)
        L, _, _, _, _ = factored
        # The orthogonal factor of more regressors begins with that of fewer.
        triangle = self._triangle(self._whitened(L))
        squares = triangle[:, -1] ** 2
        _, variance, _ = self.unpack(p)
        log_det = self._log_det(L)
        return np.array([self._value(log_det, float(squares[count:].sum()), variance) for count in terms])

    def _cholesky(self, p: Array) -> tuple[Array, Array, Array, float, Array] | None:
        """Factorise the correlation matrix; None where it is singular."""
        length, variance, nugget = self.unpack(p)
        s = np.dot(length**-2, self._squared)
        r = self.correlation.value(s)
        relative_noise = self.noise / variance
        r[self._diagonal] = 1.0 + nugget + relative_noise
        added = 0.0
        while True:
            L, info = lapack.dpftrf(len(self.f), r, uplo="L")
            if info == 0:
                return L, s, r, nugget, relative_noise
            if added >= LARGEST_NUGGET:
                return None
            more = max(9.0 * added, len(self.f) * _EPSILON)
            r[self._diagonal] += more
            added += more

    def _whitened(self, L: Array) -> Array:
        solved: Array = lapack.dtfsm(1.0, L, self._right, uplo="L")
        return solved

    def _triangle(self, whitened: Array) -> Array:
        """Triangular factor of the whitened regressors and response; the last column is the response.

        What stands below its diagonal is none of it.
        """
        packed, _, _, _ = lapack.dgeqrf(whitened)
        triangle: Array = packed[: min(packed.shape)]
        return triangle

    def _log_det(self, L: Array) -> float:
        return 2.0 * float(np.log(L[self._diagonal]).sum())

    def _value(self, log_det: float, q: float, variance: float) -> float:
        n = len(self.f)
        q = max(q, _TINY)
        if not self.noisy:
            variance = q / n
        return float(0.5 * (n * np.log(2.0 * np.pi * variance) + log_det + q / variance) / n)

    def _factor(self, p: Array) -> _Parts | None:
        """Factorise the correlation matrix and solve Eq. 17; None where the matrix is singular."""
        factored = self._cholesky(p)
        if factored is None:
            return None
        L, s, r, nugget, relative_noise = factored
        length, variance, _ = self.unpack(p)
        whitened = self._whitened(L)
        triangle = self._triangle(whitened)
        v, _ = lapack.dtrtrs(triangle[:-1, :-1], triangle[:-1, -1])
        residual = whitened[:, -1] - whitened[:, :-1] @ v
        q = max(float(residual @ residual), _TINY)
        value = self._value(self._log_det(L), q, variance)
        if not self.noisy:
            variance = q / len(self.f)
        return _Parts(value, L, residual, s, r, length, variance, nugget, relative_noise)

    def _gradient(self, parts: _Parts) -> Array:
        n = len(self.f)
        residual, variance = parts.residual, parts.variance
        gamma = lapack.dtfsm(1.0, parts.L, residual[:, None], uplo="L", trans="T")
        # W holds dlogL/dR: gamma gamma' / sigma^2 - R^-1.
        R_inv, _ = lapack.dpftri(n, parts.L, uplo="L")
        W = lapack.dsfrk(n, 1, 1.0 / variance, gamma, -1.0, R_inv, uplo="L", overwrite_c=1)
        diagonal = W[self._diagonal]
        W *= self.correlation.slope(parts.s, parts.r)
        # Every pair is there once, so the factor 1/2 of the likelihood cancels; on the diagonal s stays zero.
        slopes = [(-2.0 / parts.length**2) * (self._squared @ W)]
        if self.noisy:
            q = float(residual @ residual)
            of_noise = float(diagonal @ parts.relative_noise)
            slopes.append(np.array([-0.5 * (n - q / variance) - 0.5 * of_noise]))
        if self.fixed_nugget is None:
            slopes.append(np.array([0.5 * parts.nugget * float(diagonal.sum())]))
        return -np.concatenate(slopes)

    def screened(self, rng: np.random.Generator, terms: Sequence[int], least: int) -> tuple[Array, Array]:
        """Look at a Latin hypercube in the logarithms, at least so many points.

        Returns
        -------
        points : (m, number of hyperparameters) array
        values : (m, len(terms)) array
            Negative log-likelihoods with so many regressors.
        """
        low = [np.log(START_BOUNDS[0])] * self.dimension
        high = [np.log(START_BOUNDS[1])] * self.dimension
        if self.noisy:
            low.append(np.log(0.1))
            high.append(np.log(10.0))
        if self.fixed_nugget is None:
            low.append(np.log(1e-8))
            high.append(np.log(1e-1))
        count = max(least, SCREENING_PER_VARIABLE * len(low))
        points = qmc.scale(qmc.LatinHypercube(len(low), rng=rng).random(count), low, high)
        return points, np.array([self.values(p, terms) for p in points])


def _packed_pairs(n: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Row and column of every entry of the packed lower triangle of an (n, n) matrix."""
    numbered = np.arange(float(n * n)).reshape(n, n, order="F")
    packed, _ = lapack.dtrttf(numbered, uplo="L")
    return np.divmod(packed.astype(int), n)[::-1]
