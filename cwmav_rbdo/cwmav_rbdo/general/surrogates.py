# SPDX-License-Identifier: Apache-2.0
"""One Kriging per constraint over the same samples.

Of a constraint only the sign matters, so a response with very long tails (one over the product of two
lengths, say) is compressed before it is interpolated: ``arcsinh(y / m)``, m the median of the magnitudes of
the first samples, which fill the space, keeps zero where it is, is linear around it, and brings what is
thousands of times as large within reach.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.trend import basis
from cwmav_rbdo.wing_problem import SurrogateSettings

Array = NDArray[np.float64]
CAUTION = 2.0
"""Factor on the standard deviation where it is decided that nothing more needs to be known."""
_REFIT = 0.15  # growth of the samples after which the length scales are estimated anew
_LONG = 300.0
"""Largest magnitude of a response over that median beyond which its tails are compressed."""


class Surrogates:
    """Kriging models of the columns of the responses.

    Attributes
    ----------
    X : samples (n, D)
    Y : responses (n, K) as they are interpolated, with the signs of the true ones
    models : list of Kriging
    """

    def __init__(self, settings: SurrogateSettings, X: Array, Y: Array) -> None:
        self._settings = settings
        self.X, self.Y, self._true = X, Y, Y
        self._median = np.median(np.abs(Y), axis=0)
        self._fit()

    def add(self, X: Array, Y: Array) -> None:
        """Take new samples; length scales are estimated anew when the samples have grown by 15 %."""
        self.X, self._true = np.vstack([self.X, X]), np.vstack([self._true, Y])
        if len(self.X) > (1.0 + _REFIT) * self._fitted_on:
            self._fit()
            return
        new = self._compressed(Y)
        self.Y = np.vstack([self.Y, new])
        for model, column in zip(self.models, new.T, strict=True):
            model.add(X, column)
        self._means = [MeanFunction(model) for model in self.models]

    def mean(self, k: int, X: Array) -> Array:
        """Prediction of response `k` at rows (n, D), without the checks of the estimator."""
        return self._means[k](X)

    def predict(self, k: int, X: Array) -> tuple[Array, Array]:
        """Prediction of response `k` at rows (n, D) and its standard deviation.

        The deviation is enlarged where the leave-one-out errors say that it is too small; few samples of a
        response that is smooth in one part of the space and steep in another make it so.
        """
        mean, std = self.models[k].predict(X, return_std=True)
        return np.asarray(mean), np.asarray(std) * max(1.0, self.models[k].loo_standardised_)

    def near(self, x: Array, span: Array) -> bool:
        """Whether a sample lies within 1e-4 of the spans of `x`."""
        return bool(np.any(np.all(np.abs(self.X - x) <= 1e-4 * span, axis=1)))

    def _compressed(self, Y: Array) -> Array:
        """Compress the responses whose tails are long; the others as they are."""
        return np.where(self._long, np.arcsinh(Y / np.where(self._long, self._median, 1.0)), Y)

    def _fit(self) -> None:
        self._fitted_on = len(self.X)
        self._long = (self._median > 0.0) & (np.abs(self._true).max(axis=0) > _LONG * self._median)
        self.Y = self._compressed(self._true)
        kernel, trend = self._settings.kernel, self._settings.trend
        self.models: list[Kriging] = [Kriging(kernel, trend).fit(self.X, column) for column in self.Y.T]
        self._means = [MeanFunction(model) for model in self.models]


class MeanFunction:
    """Prediction of a fitted Kriging (Eq. 18) with all that does not depend on the new points done before.

    A search of a worst point asks for a few points thousands of times.
    """

    def __init__(self, model: Kriging) -> None:
        fitted = model.fitted_
        self._active = None if np.all(model.active_) else np.flatnonzero(model.active_)
        self._offset, self._scale = model.x_offset_[model.active_], model.x_scale_[model.active_]
        self._length, self._trend = fitted.process.length_scale, fitted.process.trend
        self._correlation = fitted.process.correlation
        self._samples = fitted.X / self._length
        self._v, self._gamma = model.y_scale_ * fitted.v, model.y_scale_ * fitted.gamma
        self._level = model.y_offset_

    def __call__(self, X: Array) -> Array:
        """Predict at rows (n, D); (n,)."""
        Z = ((X if self._active is None else X[:, self._active]) - self._offset) / self._scale
        r = self._correlation.value(cdist(Z / self._length, self._samples, "sqeuclidean"))
        h_v = self._v[0] if self._trend == "constant" else basis(self._trend, Z) @ self._v
        return np.asarray(self._level + h_v + r @ self._gamma)
