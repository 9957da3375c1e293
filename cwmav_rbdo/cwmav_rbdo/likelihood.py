# SPDX-License-Identifier: Apache-2.0
"""Hyperparameters by maximum likelihood, with analytic gradient and seeded multi-start.

The trend coefficients are always concentrated out (Eq. 17). So is the process variance when the responses
are exact; with noise of known variance it does not factor out and becomes one more variable of the search.

All lengths are in units of the scaled samples, so the bounds hold for every problem.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, qr
from scipy.optimize import minimize
from scipy.stats import qmc

from cwmav_rbdo.correlation import Correlation
from cwmav_rbdo.universal_kriging import cholesky_factor

Array = NDArray[np.float64]

LENGTH_BOUNDS = (1e-2, 1e2)
"""Shortest and longest length scale, in units of the range of the samples."""
START_BOUNDS = (2e-2, 5.0)
VARIANCE_BOUNDS = (1e-6, 1e4)
NUGGET_BOUNDS = (1e-12, 1.0)

SCREENING_PER_VARIABLE = 10
ITERATIONS = 100
_FIRST = 8
"""Iterations of every start before it is decided which of them go on."""
_RIVAL = 10.0
"""Log-likelihood by which a start may be behind then and still overtake."""
_TOGETHER = 0.1
"""Logarithms of hyperparameters closer than this are on the same hill."""
_APART = 0.7
"""Least distance of two starts in the logarithm of some hyperparameter: a factor of two."""


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
    residual: Array
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
        self._lower = np.tril_indices(n, -1)
        differences = X[self._lower[0]] - X[self._lower[1]]
        self._squared = np.ascontiguousarray((differences**2).T)
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

    def value(self, p: Array) -> float:
        """Negative log-likelihood per sample."""
        parts = self._factor(p)
        return np.inf if parts is None else parts.value

    def __call__(self, p: Array) -> tuple[float, Array]:
        """Negative log-likelihood per sample and its gradient."""
        parts = self._factor(p)
        if parts is None:
            return 1e10, np.zeros(len(p))
        return parts.value, self._gradient(parts) / len(self.f)

    def _factor(self, p: Array) -> _Parts | None:
        """Factorise the correlation matrix and solve Eq. 17; None where the matrix is singular."""
        length, variance, nugget = self.unpack(p)
        n = len(self.f)
        s = (1.0 / length**2) @ self._squared
        r = self.correlation.value(s)
        R = np.zeros((n, n), order="F")
        R[self._lower] = r
        relative_noise = self.noise / variance
        R[np.diag_indices(n)] = 1.0 + nugget + relative_noise
        try:
            L, _ = cholesky_factor(R)
        except np.linalg.LinAlgError:
            return None
        whitened, _ = lapack.dtrtrs(L, self._right, lower=1)
        Q, _ = qr(whitened[:, :-1], mode="economic", check_finite=False)
        residual = whitened[:, -1] - Q @ (Q.T @ whitened[:, -1])
        q = max(float(residual @ residual), np.finfo(float).tiny)
        if not self.noisy:
            variance = q / n
        log_det = 2.0 * float(np.sum(np.log(np.diag(L))))
        value = 0.5 * (n * np.log(2.0 * np.pi * variance) + log_det + q / variance) / n
        return _Parts(value, L, residual, s, r, length, variance, nugget, relative_noise)

    def _gradient(self, parts: _Parts) -> Array:
        n = len(self.f)
        residual, variance = parts.residual, parts.variance
        gamma, _ = lapack.dtrtrs(parts.L, residual, lower=1, trans=1)
        R_inv, _ = lapack.dpotri(parts.L, lower=1)
        # W holds dlogL/dR: gamma gamma' / sigma^2 - R^-1, of which the lower triangle is enough.
        W = gamma[self._lower[0]] * gamma[self._lower[1]]
        W /= variance
        W -= R_inv[self._lower]
        W *= self.correlation.slope(parts.s, parts.r)
        # The sum over i < j counts every pair once: the factor 1/2 of the likelihood cancels.
        slopes = [(-2.0 / parts.length**2) * (self._squared @ W)]
        diagonal = gamma**2 / variance - np.diag(R_inv)
        if self.noisy:
            q = float(residual @ residual)
            of_noise = float(diagonal @ parts.relative_noise)
            slopes.append(np.array([-0.5 * (n - q / variance) - 0.5 * of_noise]))
        if self.fixed_nugget is None:
            slopes.append(np.array([0.5 * parts.nugget * float(diagonal.sum())]))
        return -np.concatenate(slopes)

    def starts(self, rng: np.random.Generator, count: int) -> Array:
        """Best of a screened Latin hypercube in the logarithms; (count, number of hyperparameters).

        Neighbours of a better point would climb the same hill, so they give way to points elsewhere: a rough
        response has its hill at short length scales, and the long ones, where it passes for noise, another.
        """
        low = [np.log(START_BOUNDS[0])] * self.dimension
        high = [np.log(START_BOUNDS[1])] * self.dimension
        if self.noisy:
            low.append(np.log(0.1))
            high.append(np.log(10.0))
        if self.fixed_nugget is None:
            low.append(np.log(1e-8))
            high.append(np.log(1e-1))
        screened = max(count, SCREENING_PER_VARIABLE * len(low))
        points = qmc.scale(qmc.LatinHypercube(len(low), rng=rng).random(screened), low, high)
        values = np.array([self.value(p) for p in points])
        ranked = points[np.argsort(values, kind="stable")]
        chosen: list[Array] = []
        for point in ranked:
            if all(np.max(np.abs(point - other)) > _APART for other in chosen):
                chosen.append(point)
            if len(chosen) == count:
                break
        return np.array(chosen)


def maximise(likelihood: Likelihood, starts: Array) -> Hyperparameters:
    """Climb from every start with L-BFGS-B and return the best end.

    All climb a little; to the top go the best and those that may still overtake it from elsewhere.

    Parameters
    ----------
    likelihood : Likelihood
    starts : (k, number of hyperparameters) array
    """
    begun = sorted((_climb(likelihood, start, _FIRST) for start in starts), key=lambda end: end[0])
    n = len(likelihood.f)
    rivals: list[tuple[float, Array]] = []
    for value, point in begun:
        near = any(np.max(np.abs(point - other)) < _TOGETHER for _, other in rivals)
        if not near and (value - begun[0][0]) * n < _RIVAL:
            rivals.append((value, point))
    ends = [_climb(likelihood, point, ITERATIONS) for _, point in rivals]
    best_value, best_point = min([*begun, *ends], key=lambda end: end[0])
    length, variance, nugget = likelihood.unpack(best_point)
    return Hyperparameters(
        best_point, length, variance if likelihood.noisy else None, nugget, -best_value * n
    )


def _climb(likelihood: Likelihood, start: Array, iterations: int) -> tuple[float, Array]:
    found = minimize(
        likelihood,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=likelihood.bounds,
        options={"maxiter": iterations, "ftol": 1e-7, "gtol": 1e-6},
    )
    return float(found.fun), np.asarray(found.x)
