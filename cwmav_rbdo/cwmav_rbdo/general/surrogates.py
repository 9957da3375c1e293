# SPDX-License-Identifier: Apache-2.0
"""One Kriging per constraint over the same samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_rbdo import universal_kriging as uk
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.wing_problem import SurrogateSettings

Array = NDArray[np.float64]
CAUTION = 2.0
"""Factor on the standard deviation where it is decided that nothing more needs to be known."""
_REFIT = 0.15  # growth of the samples after which the length scales are estimated anew


class Surrogates:
    """Kriging models of the columns of the responses.

    Attributes
    ----------
    X, Y : samples (n, D) and responses (n, K)
    models : list of Kriging
    """

    def __init__(self, settings: SurrogateSettings, X: Array, Y: Array) -> None:
        self._settings = settings
        self.X, self.Y = X, Y
        self._fit()

    def add(self, X: Array, Y: Array) -> None:
        """Take new samples; length scales are estimated anew when the samples have grown by 15 %."""
        self.X, self.Y = np.vstack([self.X, X]), np.vstack([self.Y, Y])
        if len(self.X) > (1.0 + _REFIT) * self._fitted_on:
            self._fit()
            return
        for model, column in zip(self.models, Y.T, strict=True):
            model.add(X, column)

    def mean(self, k: int, X: Array) -> Array:
        """Prediction of response `k` at rows (n, D), without the checks of the estimator."""
        model = self.models[k]
        Z = ((X - model.x_offset_) / np.where(model.active_, model.x_scale_, 1.0))[:, model.active_]
        return np.asarray(model.y_offset_ + model.y_scale_ * uk.predict(model.fitted_, Z))

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

    def _fit(self) -> None:
        self._fitted_on = len(self.X)
        kernel, trend = self._settings.kernel, self._settings.trend
        self.models = [Kriging(kernel, trend).fit(self.X, column) for column in self.Y.T]
