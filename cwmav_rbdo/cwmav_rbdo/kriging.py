# SPDX-License-Identifier: Apache-2.0
"""Kriging as a scikit-learn regressor: units, scaling, hyperparameters, recoveries.

The equations are in :mod:`cwmav_rbdo.universal_kriging` (Appendix I of the paper), the likelihood in
:mod:`cwmav_rbdo.likelihood`. Inside, every variable is shifted and scaled to [-1/2, 1/2] by the range of
the samples and the response to zero mean and unit variance, so that shifting or scaling a variable changes
nothing but units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import repeat
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from cwmav_common.errors import InputError
from cwmav_rbdo import universal_kriging as uk
from cwmav_rbdo.correlation import correlation
from cwmav_rbdo.likelihood import Hyperparameters, Likelihood
from cwmav_rbdo.multistart import maximise, well_apart
from cwmav_rbdo.replicates import merge_replicates
from cwmav_rbdo.threads import for_each_block, single_thread
from cwmav_rbdo.trend import TRENDS, basis, terms
from cwmav_rbdo.universal_kriging import Process

Array = NDArray[np.float64]

BLOCK_ENTRIES = 1 << 17
"""Entries of the correlation between new points and samples that are made at once: 1 MiB, near the cache."""
EVIDENCE = 3.0
"""A richer trend must make the left-out samples exp(3) = 20 times more probable."""
_UNRESOLVED = 1e-12
"""A spread this small relative to the magnitude is rounding, not information."""


class Kriging(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Universal Kriging (Appendix I of the paper) with noise per point and automatic trend.

    Parameters
    ----------
    kernel : {"gaussian", "matern52"}
        Correlation function, one length scale per variable.
    trend : {"constant", "linear", "quadratic", "auto"}
        Regression functions of Eq. 15; "auto" takes a richer trend where it makes the samples, each left
        out in turn, clearly more probable, and where there are at least twice as many samples as
        coefficients.
    length_scale : (d,) array or float, optional
        Fixed length scales in the units of X; by default they maximise the likelihood.
    nugget : float or "estimate", optional
        Added to the diagonal of the correlation matrix, relative to the process variance. The default is as
        small as rounding allows; "estimate" searches it with the length scales, for noise of unknown size.
    starts : int
        Number of local searches of the likelihood, begun at the best of a screened Latin hypercube.
    random_state : int, numpy.random.Generator or None
        Seed of the starts. None means entropy from the system: then two fits may differ.

    Attributes
    ----------
    length_scale_ : (d,) array
        In the units of X; infinite for a variable that is constant in the samples.
    trend_ : str
    process_variance_ : float
        sigma_Delta^2 of Eq. 16 in squared units of y.
    log_likelihood_ : float
        Of the scaled response; nan when the length scales were given.
    loo_log_density_ : float
        Logarithm of the predictive density of the samples (scaled response), each left out in turn.
    loo_standardised_ : float
        Root mean square of the leave-one-out errors in units of their predicted standard deviations; about 1
        where the mean square error of Eq. 20 is honest.
    loo_rmse_ : float
        Closed-form leave-one-out error in units of y.
    recoveries_ : tuple of str
        What had to be mended: replicates merged, constant variable or response.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.linspace(0.0, 1.0, 9)[:, None]
    >>> model = Kriging().fit(X, np.sin(5.0 * X[:, 0]))
    >>> mean, mse = model.predict(np.array([[0.31]]), return_mse=True)
    >>> bool(abs(mean[0] - np.sin(1.55)) < 1e-3)
    True
    """

    def __init__(
        self,
        kernel: str = "gaussian",
        trend: str = "constant",
        *,
        length_scale: ArrayLike | None = None,
        nugget: float | str | None = None,
        starts: int = 3,
        random_state: int | np.random.Generator | None = 0,
    ) -> None:
        self.kernel = kernel
        self.trend = trend
        self.length_scale = length_scale
        self.nugget = nugget
        self.starts = starts
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike, noise_variance: ArrayLike | None = None) -> Self:
        """Estimate trend, length scales and process variance.

        Parameters
        ----------
        X : (n, d) array
            Samples, n >= 2.
        y : (n,) array
            Responses.
        noise_variance : (n,) array or float, optional
            Variance of the error of each response, squared units of y.

        Raises
        ------
        InputError
            On anything not finite, fewer than two samples, too few samples for the trend, a negative noise
            variance.
        """
        self._check_parameters()
        X, y = self._validated(X, y)
        noise = self._noise(noise_variance, len(y))
        X, y, noise, recoveries = merge_replicates(X, y, noise)
        if len(y) < 2:
            raise InputError("X: all samples are at one point; Kriging needs at least 2 different ones")
        self._set_scaling(X, y, recoveries)
        Z, f, scaled_noise = (
            self._to_scaled(X),
            (y - self.y_offset_) / self.y_scale_,
            noise / self.y_scale_**2,
        )
        with single_thread():
            fitted, likelihood = self._fit_scaled(Z, f, scaled_noise)
        self._store(fitted)
        self.log_likelihood_ = likelihood
        self.trend_ = fitted.process.trend
        self.recoveries_ = tuple(recoveries)
        return self

    def predict(
        self, X: ArrayLike, return_std: bool = False, return_mse: bool = False
    ) -> Array | tuple[Array, Array]:
        """Predict the response without noise (Eq. 18).

        Parameters
        ----------
        X : (m, d) array
        return_std : bool
            Return the pair of mean and standard deviation.
        return_mse : bool
            Return the pair of mean and mean square error (Eq. 20).

        Returns
        -------
        mean : (m,) array
        std or mse : (m,) array
            Only when asked for.
        """
        Z = self._new_points(X)
        if not (return_std or return_mse):
            mean = _in_blocks(uk.predict, self.fitted_, Z, ())
            return self.y_offset_ + self.y_scale_ * mean
        pair = _in_blocks(uk.predict_with_mse, self.fitted_, Z, (2,))
        mean = self.y_offset_ + self.y_scale_ * pair[:, 0]
        mse = self.y_scale_**2 * pair[:, 1]
        return mean, mse if return_mse else np.sqrt(mse)

    def gradient(self, X: ArrayLike) -> Array:
        """Gradient of the prediction, (m, d), in units of y per unit of each variable."""
        return self._gradient(X, uk.gradient, self.y_scale_)

    def mse_gradient(self, X: ArrayLike) -> Array:
        """Gradient of the mean square error of Eq. 20, (m, d)."""
        return self._gradient(X, uk.mse_gradient, self.y_scale_**2)

    def add(self, X: ArrayLike, y: ArrayLike, noise_variance: ArrayLike | None = None) -> Self:
        """Add samples without estimating the length scales anew, in O(n^2) per sample.

        The scaling, length scales and nugget stay; trend coefficients and, for exact responses, the process
        variance are updated. A sample on top of an old one makes this fall back on a factorisation with a
        larger nugget.

        Raises
        ------
        InputError
            As :meth:`fit`.
        """
        check_is_fitted(self)
        X, y = self._validated(X, y, reset=False, least=1)
        noise = self._noise(noise_variance, len(y)) / self.y_scale_**2
        Z, f = self._to_scaled(X), (y - self.y_offset_) / self.y_scale_
        old = self.fitted_
        keep = bool(np.any(old.noise) or np.any(noise))
        try:
            fitted = uk.border(old, Z, f, noise, keep)
        except np.linalg.LinAlgError:
            fitted = uk.condition(
                old.process,
                np.vstack([old.X, Z]),
                np.concatenate([old.f, f]),
                np.concatenate([old.noise, noise]),
                old.process_variance if keep else None,
            )
            self.recoveries_ = (*self.recoveries_, "added sample on top of another: nugget enlarged")
        self._store(fitted)
        return self

    def _check_parameters(self) -> None:
        correlation(self.kernel)
        if self.trend not in (*TRENDS, "auto"):
            raise InputError(f"trend = {self.trend!r}: allowed are {', '.join(TRENDS)}, auto")
        if isinstance(self.nugget, str) and self.nugget != "estimate":
            raise InputError(f"nugget = {self.nugget!r}: allowed are a number >= 0, 'estimate' or None")
        if isinstance(self.nugget, int | float) and self.nugget < 0:
            raise InputError(f"nugget = {self.nugget!r}: allowed are a number >= 0, 'estimate' or None")
        if self.starts < 1:
            raise InputError(f"starts = {self.starts!r}: allowed is an integer >= 1")

    def _validated(
        self, X: ArrayLike, y: ArrayLike, reset: bool = True, least: int = 2
    ) -> tuple[Array, Array]:
        try:
            checked, response = validate_data(
                self, X, y, y_numeric=True, dtype=np.float64, ensure_min_samples=least, reset=reset
            )
        except ValueError as error:
            raise InputError(str(error)) from error
        return checked, np.asarray(response, dtype=np.float64)

    def _noise(self, noise_variance: ArrayLike | None, n: int) -> Array:
        if noise_variance is None:
            return np.zeros(n)
        noise = np.asarray(noise_variance, dtype=np.float64)
        if noise.shape not in ((), (n,)):
            raise InputError(f"noise_variance: shape {noise.shape}, expected a number or ({n},)")
        wrong = ~(np.isfinite(noise) & (noise >= 0.0))
        if np.any(wrong):
            raise InputError(f"noise_variance: {noise[wrong].flat[0]} is not a finite number >= 0")
        return np.broadcast_to(noise, (n,)).copy()

    def _set_scaling(self, X: Array, y: Array, recoveries: list[str]) -> None:
        low, high = X.min(axis=0), X.max(axis=0)
        self.x_offset_ = 0.5 * (low + high)
        self.x_scale_ = high - low
        self.active_ = self.x_scale_ > _UNRESOLVED * np.maximum(np.abs(low), np.abs(high))
        constant = np.flatnonzero(~self.active_)
        if len(constant):
            recoveries.append(f"constant variable left out: column {', '.join(map(str, constant))}")
        self.y_offset_ = float(y.mean())
        with np.errstate(over="ignore"):
            self.y_scale_ = float(y.std())
        if not np.isfinite(self.y_scale_):
            raise InputError(
                f"y: values as large as {np.abs(y).max():.3g} have no variance in this arithmetic"
            )
        if self.y_scale_ <= _UNRESOLVED * float(np.abs(y).max()):
            recoveries.append("constant response: predicted everywhere with zero error")
            self.y_scale_ = 1.0

    def _to_scaled(self, X: Array) -> Array:
        scaled: Array = (X - self.x_offset_) / np.where(self.active_, self.x_scale_, 1.0)
        return scaled[:, self.active_]

    def _new_points(self, X: ArrayLike) -> Array:
        check_is_fitted(self)
        if self._is_plain(X):
            return self._to_scaled(X)  # type: ignore[arg-type]
        try:
            checked = validate_data(self, X, dtype=np.float64, reset=False)
        except ValueError as error:
            raise InputError(str(error)) from error
        return self._to_scaled(checked)

    def _is_plain(self, X: ArrayLike) -> bool:
        """Whether X needs no conversion and no complaint; a swarm asks so often that looking longer costs."""
        return (
            type(X) is np.ndarray
            and X.dtype == np.float64
            and X.ndim == 2
            and X.shape[1] == self.n_features_in_
            and len(X) > 0
            and not hasattr(self, "feature_names_in_")
            and bool(np.all(np.isfinite(X)))
        )

    def _candidates(self, n: int, d: int) -> list[str]:
        if self.trend == "auto":
            return [t for t in TRENDS if t == "constant" or n >= 2 * len(terms(t, d))]
        needed = len(terms(self.trend, d))
        if n < needed + (needed > 1):
            raise InputError(f"trend = {self.trend!r}: needs {needed + 1} different samples, got {n}")
        return [self.trend]

    def _fit_scaled(self, Z: Array, f: Array, noise: Array) -> tuple[uk.Fitted, float]:
        """Fit every candidate trend and keep the one with the least leave-one-out error."""
        candidates = self._candidates(*Z.shape)
        counts = [len(terms(trend, Z.shape[1])) for trend in candidates]
        smallest = (10.0 + len(f)) * np.finfo(float).eps
        nugget = None if self.nugget == "estimate" else float(self.nugget or smallest)
        likelihood = Likelihood(correlation(self.kernel), Z, f, basis(candidates[-1], Z), noise, nugget)
        fits = []
        for trend, found in zip(candidates, self._found(likelihood, counts, nugget or smallest), strict=True):
            process = Process(correlation(self.kernel), trend, found.length_scale, found.nugget)
            fitted = uk.condition(process, Z, f, noise, found.process_variance)
            fits.append((fitted, found.log_likelihood))
        best = fits[0]
        for fit in fits[1:]:
            if uk.loo_log_density(fit[0]) > uk.loo_log_density(best[0]) + EVIDENCE:
                best = fit
        return best

    def _found(
        self, likelihood: Likelihood, counts: Sequence[int], nugget: float
    ) -> Iterator[Hyperparameters]:
        """Give the hyperparameters with so many regressors; from simple to rich."""
        if self.length_scale is not None:
            yield from repeat(self._given(likelihood, nugget), len(counts))
            return
        if not np.any(likelihood.f):
            flat = _unsearched(np.ones(likelihood.dimension), likelihood.noisy, nugget)
            yield from repeat(flat, len(counts))
            return
        rng = np.random.default_rng(self.random_state)
        points, values = likelihood.screened(rng, counts, self.starts)
        starts = well_apart(points, values[:, 0], self.starts)
        for k, count in enumerate(counts):
            found = maximise(likelihood.restricted(count), starts)
            yield found
            if k + 1 < len(counts):
                # The optimum of a simpler trend is a good start; another guards against its neighbourhood.
                starts = np.vstack([found.logarithms, well_apart(points, values[:, k + 1], 1)])

    def _given(self, likelihood: Likelihood, nugget: float) -> Hyperparameters:
        length = np.broadcast_to(np.asarray(self.length_scale, dtype=np.float64), self.x_scale_.shape)
        if not np.all(length > 0.0):
            raise InputError(f"length_scale = {self.length_scale!r}: every entry must be > 0")
        scaled = (length / self.x_scale_)[self.active_]
        return _unsearched(scaled, likelihood.noisy, nugget)

    def _store(self, fitted: uk.Fitted) -> None:
        self.fitted_ = fitted
        self.length_scale_ = np.full(len(self.x_scale_), np.inf)
        self.length_scale_[self.active_] = fitted.process.length_scale * self.x_scale_[self.active_]
        self.process_variance_ = fitted.process_variance * self.y_scale_**2
        errors, variances = uk.leave_one_out(fitted)
        self.loo_rmse_ = self.y_scale_ * float(np.sqrt(np.mean(errors**2)))
        standardised = np.where(variances > 0.0, errors**2 / np.where(variances > 0.0, variances, 1.0), 1.0)
        self.loo_standardised_ = float(np.sqrt(np.mean(standardised)))
        self.loo_log_density_ = uk.loo_log_density(fitted)

    def _gradient(self, X: ArrayLike, function: Callable[[uk.Fitted, Array], Array], unit: float) -> Array:
        Z = self._new_points(X)
        scaled = _in_blocks(function, self.fitted_, Z, (Z.shape[1],))
        full = np.zeros((len(Z), len(self.x_scale_)))
        full[:, self.active_] = unit * scaled / self.x_scale_[self.active_]
        return full

    def __sklearn_tags__(self) -> Any:
        """Tell scikit-learn's checks that a smooth interpolator is no good on their noisy toy data."""
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        return tags


def _unsearched(length: Array, noisy: bool, nugget: float) -> Hyperparameters:
    return Hyperparameters(np.empty(0), length, 1.0 if noisy else None, nugget, np.nan)


def _in_blocks(
    function: Callable[[uk.Fitted, Array], Array], fitted: uk.Fitted, Z: Array, shape: tuple[int, ...]
) -> Array:
    """Evaluate a function of new points block by block, so that memory stays bounded."""
    out = np.empty((len(Z), *shape))
    rows = max(BLOCK_ENTRIES // len(fitted.X), 1)

    def fill(block: slice) -> None:
        out[block] = function(fitted, Z[block])

    for_each_block(fill, [slice(start, start + rows) for start in range(0, len(Z), rows)])
    return out
