# SPDX-License-Identifier: Apache-2.0
"""Random inputs: marginals joined by a Gaussian copula, as a map from the standard normal space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from cwmav_common.errors import InputError

Array = NDArray[np.float64]
LimitState = Callable[[Array], Array]
"""Limit state g: physical points (n, d) -> (n,); safe where g > 0, failed where g <= 0."""


class Marginal(Protocol):
    """What is used of a frozen scipy.stats distribution."""

    def ppf(self, q: ArrayLike) -> Array:
        """Inverse of the cumulative distribution."""
        ...

    def isf(self, q: ArrayLike) -> Array:
        """Inverse of the survival function, accurate in the upper tail."""
        ...


class Inputs(Protocol):
    """Random vector as a function of independent standard normal variables."""

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        ...

    def from_standard(self, U: Array) -> Array:
        """Map standard normal points (n, d) to physical ones (n, d)."""
        ...


def _copula_factor(correlation: ArrayLike | None, d: int) -> Array | None:
    if correlation is None:
        return None
    C = np.asarray(correlation, dtype=np.float64)
    if C.shape != (d, d) or not np.allclose(C, C.T) or not np.allclose(np.diag(C), 1.0):
        raise InputError(f"correlation: expected a symmetric ({d}, {d}) matrix with ones on the diagonal")
    try:
        return np.asarray(np.linalg.cholesky(C), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise InputError(
            f"correlation: not positive definite (least eigenvalue {np.linalg.eigvalsh(C)[0]:.3g})"
        ) from None


class GaussianNoise:
    """Normal scatter around a design: ``x = mean + std * z``, possibly correlated.

    Parameters
    ----------
    mean : (d,) array
    std : (d,) array
        Standard deviations; zero for a variable that does not scatter.
    correlation : (d, d) array, optional

    Raises
    ------
    InputError
        On shapes that do not match, a negative or non-finite standard deviation, an impossible correlation.
    """

    def __init__(self, mean: ArrayLike, std: ArrayLike, correlation: ArrayLike | None = None) -> None:
        self.mean = np.asarray(mean, dtype=np.float64)
        self.std = np.asarray(std, dtype=np.float64)
        if self.mean.ndim != 1 or self.mean.shape != self.std.shape:
            raise InputError(
                f"noise: shapes {self.mean.shape} and {self.std.shape}, expected twice the same (d,)"
            )
        if not (np.all(np.isfinite(self.mean)) and np.all(np.isfinite(self.std)) and np.all(self.std >= 0.0)):
            raise InputError(f"noise: mean {self.mean}, std {self.std}; must be finite and std >= 0")
        self._factor = _copula_factor(correlation, len(self.mean))

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.mean)

    def from_standard(self, U: Array) -> Array:
        """Map standard normal points (n, d) to physical ones."""
        Z = U if self._factor is None else U @ self._factor.T
        return self.mean + self.std * Z


class Copula:
    """Any marginals, joined by a Gaussian copula.

    Parameters
    ----------
    marginals : sequence of d frozen scipy.stats distributions
    correlation : (d, d) array, optional
        Correlation of the underlying normal variables, not of the physical ones.
    """

    def __init__(self, marginals: Sequence[Marginal], correlation: ArrayLike | None = None) -> None:
        if not marginals:
            raise InputError("marginals: none given; at least one random variable is needed")
        self.marginals = tuple(marginals)
        self._factor = _copula_factor(correlation, len(self.marginals))

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.marginals)

    def from_standard(self, U: Array) -> Array:
        """Map standard normal points (n, d) to physical ones."""
        Z = U if self._factor is None else U @ self._factor.T
        X = np.empty_like(Z)
        for k, marginal in enumerate(self.marginals):
            upper = Z[:, k] > 0.0
            X[~upper, k] = marginal.ppf(ndtr(Z[~upper, k]))
            X[upper, k] = marginal.isf(ndtr(-Z[upper, k]))
        return X


def standard_limit_state(g: LimitState, inputs: Inputs) -> LimitState:
    """Express a limit state in the standard normal space, refusing values that are not finite.

    Raises
    ------
    InputError
        On calling, when g returns NaN or the wrong shape.
    """

    def of_standard(U: Array) -> Array:
        X = inputs.from_standard(U)
        values = np.asarray(g(X), dtype=np.float64)
        if values.shape != (len(U),):
            raise InputError(f"limit state: returned shape {values.shape} for {len(U)} points")
        if np.any(np.isnan(values)):
            where = X[int(np.argmax(np.isnan(values)))]
            raise InputError(f"limit state: NaN at {np.array2string(where, precision=6)}")
        return values

    return of_standard
