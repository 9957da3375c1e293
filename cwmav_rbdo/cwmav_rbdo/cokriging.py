# SPDX-License-Identifier: Apache-2.0
"""Autoregressive co-kriging: many coarse runs and few fine ones make one surrogate.

The equations are in :mod:`cwmav_rbdo.autoregressive`. Length scales, variances and the factors rho are
estimated level by level, as Le Gratiet and Garnier (2014, Int. J. Uncertainty Quantification 4:365) do: the
coarser level is predicted at the finer samples, the discrepancy is Kriging of what remains, and rho is what
makes it the most likely. Where the finer points are not among the coarser ones, the error of that prediction
counts as noise of the discrepancy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.utils.validation import check_is_fitted

from cwmav_common.errors import InputError
from cwmav_rbdo import autoregressive as ar
from cwmav_rbdo.correlation import correlation
from cwmav_rbdo.kriging import BLOCK_ENTRIES, Kriging
from cwmav_rbdo.threads import single_thread

Array = NDArray[np.float64]

LEAST_FINE = 3
"""Samples of a finer level without which neither rho nor a discrepancy can be told."""
_SEARCH = 2.0  # reach of the search for rho beyond the least-squares value, in units of std(fine)/std(coarse)


@dataclass(frozen=True)
class _Step:
    """From one level to the next finer one."""

    rho: float
    discrepancy: Kriging


class CoKriging(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Kriging of the finest level of a hierarchy of models.

    Parameters
    ----------
    coarse : Kriging, optional
        Settings of the coarsest level; a clone of it is fitted.
    discrepancy : Kriging, optional
        Settings of every discrepancy.

    Attributes
    ----------
    spacings_ : (levels,) array
        Particle spacings from coarse to fine.
    rho_ : (levels - 1,) array
        Factor of every step.
    coarse_ : Kriging
    recoveries_ : tuple of str

    Examples
    --------
    >>> import numpy as np
    >>> X = np.concatenate([np.linspace(0.0, 1.0, 11), [0.0, 0.4, 0.6, 1.0]])[:, None]
    >>> f = lambda x: (6.0 * x - 2.0) ** 2 * np.sin(12.0 * x - 4.0)
    >>> spacing = np.repeat([8.0, 4.0], [11, 4])
    >>> y = np.where(spacing == 4.0, f(X[:, 0]), 0.5 * f(X[:, 0]) + 10.0 * (X[:, 0] - 0.5) - 5.0)
    >>> model = CoKriging(discrepancy=Kriging(trend="linear")).fit(X, y, spacing)
    >>> bool(abs(model.predict([[0.757]])[0] + 6.02) < 0.1)
    True
    """

    def __init__(self, coarse: Kriging | None = None, discrepancy: Kriging | None = None) -> None:
        self.coarse = coarse
        self.discrepancy = discrepancy

    def fit(
        self, X: ArrayLike, y: ArrayLike, spacing: ArrayLike, noise_variance: ArrayLike | None = None
    ) -> Self:
        """Fit all levels.

        Parameters
        ----------
        X : (n, d) array
            Samples of all levels.
        y : (n,) array
        spacing : (n,) array
            Particle spacing of each sample, > 0; equal values are one level, smaller ones are finer.
        noise_variance : (n,) array or float, optional
            Variance of the error of each response.

        Raises
        ------
        InputError
            As :meth:`Kriging.fit`; a finer level with fewer than three samples; a spacing that is no number
            > 0.
        """
        points, values = np.asarray(X, dtype=np.float64), np.asarray(y, dtype=np.float64)
        levels = np.asarray(spacing, dtype=np.float64)
        if points.ndim != 2 or values.shape != (len(points),) or levels.shape != (len(points),):
            raise InputError(
                f"X, y, spacing: shapes {points.shape}, {values.shape} and {levels.shape}; "
                "expected (n, d), (n,) and (n,)"
            )
        wrong = ~(np.isfinite(levels) & (levels > 0.0))
        if np.any(wrong):
            raise InputError(f"spacing: {levels[wrong][0]} is not allowed; expected numbers > 0")
        noise = np.zeros(len(values)) if noise_variance is None else np.asarray(noise_variance, dtype=float)
        noise = np.broadcast_to(noise, values.shape)
        self.spacings_ = np.unique(levels)[::-1]
        at = [levels == s for s in self.spacings_]
        self.coarse_ = clone(self.coarse or Kriging()).fit(points[at[0]], values[at[0]], noise[at[0]])
        self.steps_: list[_Step] = []
        for rows, s in zip(at[1:], self.spacings_[1:], strict=True):
            count = np.count_nonzero(rows)
            if count < LEAST_FINE:
                raise InputError(f"spacing {s:g}: {count} samples; a finer level needs at least {LEAST_FINE}")
            self.steps_.append(self._step(points[rows], values[rows], noise[rows]))
        self.rho_ = np.array([step.rho for step in self.steps_])
        self.recoveries_ = tuple(note for model in self._models() for note in model.recoveries_)
        self.n_features_in_ = points.shape[1]
        self._offset, extent = points.mean(axis=0), np.ptp(points, axis=0)
        self._scale = np.where(extent > 0.0, extent, 1.0)
        index = len(self.spacings_) - 1 - np.searchsorted(self.spacings_[::-1], levels)
        self._condition((points - self._offset) / self._scale, index, values, noise)
        return self

    def predict(
        self, X: ArrayLike, return_std: bool = False, return_mse: bool = False
    ) -> Array | tuple[Array, Array]:
        """Predict the finest level; see :meth:`Kriging.predict`."""
        mean, mse = _in_blocks(ar.predict, self.joint_, self._scaled(X))
        if return_mse:
            return mean, mse
        return (mean, np.sqrt(mse)) if return_std else mean

    def gradient(self, X: ArrayLike) -> Array:
        """Gradient of the prediction, (m, d)."""
        return np.asarray(_in_blocks(ar.gradients, self.joint_, self._scaled(X))[0] / self._scale)

    def mse_gradient(self, X: ArrayLike) -> Array:
        """Gradient of the mean square error, (m, d)."""
        return np.asarray(_in_blocks(ar.gradients, self.joint_, self._scaled(X))[1] / self._scale)

    def add(self, X: ArrayLike, y: ArrayLike, noise_variance: ArrayLike | None = None) -> Self:
        """Add samples of the finest level; length scales, variances and rho stay.

        Raises
        ------
        InputError
            On anything not finite.
        """
        Z, values = self._scaled(X), np.asarray(y, dtype=np.float64)
        if values.shape != (len(Z),) or not np.all(np.isfinite(values)):
            raise InputError(f"y: {values}; expected {len(Z)} finite numbers")
        noise = np.broadcast_to(
            0.0 if noise_variance is None else np.asarray(noise_variance, float), values.shape
        )
        old = self.joint_
        self._condition(
            np.vstack([old.X, Z]),
            np.concatenate([old.level, np.full(len(Z), len(self.spacings_) - 1)]),
            np.concatenate([old.y, values]),
            np.concatenate([old.noise, noise]),
        )
        return self

    def _scaled(self, X: ArrayLike) -> Array:
        check_is_fitted(self)
        points = np.asarray(X, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != self.n_features_in_ or not np.all(np.isfinite(points)):
            raise InputError(f"X: expected finite numbers of shape (m, {self.n_features_in_})")
        return np.asarray((points - self._offset) / self._scale)

    def _condition(self, Z: Array, level: NDArray[np.int_], y: Array, noise: Array) -> None:
        increments = [
            ar.Increment(
                correlation(model.kernel),
                model.trend_,
                model.length_scale_ / self._scale,
                model.process_variance_,
            )
            for model in self._models()
        ]
        with single_thread():
            self.joint_ = ar.condition(increments, [step.rho for step in self.steps_], Z, level, y, noise)

    def _models(self) -> list[Kriging]:
        return [self.coarse_, *(step.discrepancy for step in self.steps_)]

    def _up_to(self, steps: int, X: ArrayLike) -> tuple[Array, Array]:
        """Prediction and its error after the first `steps` steps."""
        mean, mse = self.coarse_.predict(X, return_mse=True)
        for step in self.steps_[:steps]:
            more, more_mse = step.discrepancy.predict(X, return_mse=True)
            mean, mse = step.rho * mean + more, step.rho**2 * mse + more_mse
        return np.asarray(mean), np.asarray(mse)

    def _step(self, X: Array, y: Array, noise: Array) -> _Step:
        """Find the rho whose discrepancy is the most likely."""
        below, below_mse = self._up_to(len(self.steps_), X)

        def fitted(rho: float) -> Kriging:
            variance = noise + rho**2 * below_mse
            # What is left of a coarse error at a point that both levels share is rounding, not noise.
            variance = np.where(variance > 1e-10 * np.var(y), variance, 0.0)
            model: Kriging = clone(self.discrepancy or Kriging())
            return model.fit(X, y - rho * below, variance)

        def unlikely(rho: float) -> float:
            model = fitted(rho)
            if not np.isfinite(model.log_likelihood_):
                return -np.inf if model.process_variance_ == 0.0 else np.inf
            # The likelihood is that of the scaled discrepancy; only in units of y can two be compared.
            return float(len(X) * np.log(model.y_scale_) - model.log_likelihood_)

        spread = float(np.std(below))
        if spread <= 1e-12 * float(np.abs(below).max(initial=0.0)) or spread == 0.0:
            return _Step(1.0, fitted(1.0))  # a flat coarse level says nothing about a factor
        middle = float(np.cov(below, y)[0, 1] / np.var(below, ddof=1))
        reach = _SEARCH * max(float(np.std(y)) / spread, 1e-3)
        found: Any = minimize_scalar(
            unlikely,
            bounds=(middle - reach, middle + reach),
            method="bounded",
            options={"xatol": 1e-3 * reach},
        )
        rho = float(found.x) if unlikely(float(found.x)) <= unlikely(middle) else middle
        return _Step(rho, fitted(rho))


class WithCoarseRuns(CoKriging):
    """Co-kriging whose coarser levels are there from the beginning; fitted like a Kriging to the finest.

    Parameters
    ----------
    X, y, noise_variance, spacing : arrays
        Samples of the coarser levels, as :meth:`CoKriging.fit` takes them.
    coarse, discrepancy : Kriging, optional
        Settings.
    """

    def __init__(
        self,
        X: Array,
        y: Array,
        noise_variance: Array,
        spacing: Array,
        coarse: Kriging | None = None,
        discrepancy: Kriging | None = None,
    ) -> None:
        super().__init__(coarse, discrepancy)
        self.X, self.y, self.noise_variance, self.spacing = X, y, noise_variance, spacing

    def fit(  # type: ignore[override]
        self, X: ArrayLike, y: ArrayLike, noise_variance: ArrayLike | None = None
    ) -> Self:
        """Fit to samples of the finest level."""
        points, values = np.asarray(X, dtype=np.float64), np.asarray(y, dtype=np.float64)
        noise = np.zeros(len(values)) if noise_variance is None else np.asarray(noise_variance, dtype=float)
        if len(values) < LEAST_FINE:
            raise InputError(f"{len(values)} samples of the finest level; needed are {LEAST_FINE}")
        finest = np.full(len(values), 0.5 * float(np.min(self.spacing)))  # only the order of spacings counts
        super().fit(
            np.vstack([self.X, points]),
            np.concatenate([self.y, values]),
            np.concatenate([self.spacing, finest]),
            np.concatenate([self.noise_variance, np.broadcast_to(noise, values.shape)]),
        )
        return self


def _in_blocks(
    function: Callable[[ar.Joint, Array], tuple[Array, Array]], joint: ar.Joint, Z: Array
) -> tuple[Array, Array]:
    rows = max(BLOCK_ENTRIES // len(joint.X), 1)
    with single_thread():
        parts = [function(joint, Z[first : first + rows]) for first in range(0, max(len(Z), 1), rows)]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
