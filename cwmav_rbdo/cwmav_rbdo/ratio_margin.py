# SPDX-License-Identifier: Apache-2.0
"""Limit states of the wing study on its surrogate: ratio (Eq. 14) or lift minus the required one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_rbdo.grid_prediction import predict_on_grid
from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower, RatioSurrogate

Array = NDArray[np.float64]


class RatioMargin:
    """``G(d) = L/P(d) - R1`` with the surfaces the reliability methods ask for.

    Parameters
    ----------
    surrogate : RatioSurrogate
        Fitted.
    required : float
        R1 in N/W.
    shift : float
        Standard deviations of the surrogate added to its mean: -1.96 gives the pessimistic surface of a band.
    """

    def __init__(self, surrogate: RatioSurrogate, required: float, shift: float = 0.0) -> None:
        self.surrogate = surrogate
        self.required = required
        self.shift = shift

    def __call__(self, X: Array) -> Array:
        """Margin at X (n, d); (n,), N/W."""
        if self.shift == 0.0:
            return self.surrogate.mean(X) - self.required
        mean, std = self.surrogate.predict(X)
        return mean + self.shift * std - self.required

    def with_std(self, X: Array) -> tuple[Array, Array]:
        """Mean of the margin and the surrogate's standard deviation; (n,) each."""
        mean, std = self.surrogate.predict(X)
        return mean - self.required, std

    def on_grid(self, axes: list[Array]) -> NDArray[np.floating]:
        """Margin of the mean surface at every node of a tensor grid.

        The power is held at its floor exactly as point by point. A shifted margin has no such short cut, nor
        has a surrogate of the user's own.
        """
        if self.shift != 0.0 or not isinstance(self.surrogate, LiftToPower | DirectRatio):
            mesh = np.meshgrid(*axes, indexing="ij")
            return self(np.stack([m.ravel() for m in mesh], axis=1)).reshape(mesh[0].shape)
        if isinstance(self.surrogate, DirectRatio):
            return predict_on_grid(self.surrogate.ratio_, axes) - np.float32(self.required)
        power = predict_on_grid(self.surrogate.power_, axes)
        np.maximum(power, np.float32(self.surrogate.power_floor_), out=power)
        margin = predict_on_grid(self.surrogate.lift_, axes)
        margin /= power
        margin -= np.float32(self.required)
        return margin


class LiftMargin:
    """``G(d) = lift(d) - required``: the weight is carried.

    Parameters
    ----------
    surrogate : LiftToPower
        Fitted.
    required : float
        Lift in N.
    shift : float
        As for :class:`RatioMargin`.
    """

    def __init__(self, surrogate: LiftToPower, required: float, shift: float = 0.0) -> None:
        self.surrogate = surrogate
        self.required = required
        self.shift = shift

    def __call__(self, X: Array) -> Array:
        """Margin at X (n, d); (n,), N."""
        if self.shift == 0.0:
            return np.asarray(self.surrogate.lift_.predict(X)) - self.required
        mean, std = self.surrogate.lift_.predict(X, return_std=True)
        return np.asarray(mean + self.shift * std - self.required)

    def on_grid(self, axes: list[Array]) -> NDArray[np.floating]:
        """Margin of the mean surface at every node of a tensor grid; a shifted one point by point."""
        if self.shift != 0.0:
            mesh = np.meshgrid(*axes, indexing="ij")
            return self(np.stack([m.ravel() for m in mesh], axis=1)).reshape(mesh[0].shape)
        return predict_on_grid(self.surrogate.lift_, axes) - np.float32(self.required)
