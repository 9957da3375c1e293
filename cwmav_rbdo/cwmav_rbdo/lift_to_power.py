# SPDX-License-Identifier: Apache-2.0
"""Surrogates of the lift-to-power ratio: two Krigings, of lift and of power, or one of the ratio itself."""

from __future__ import annotations

from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from cwmav_common.errors import InputError
from cwmav_rbdo.cokriging import WithCoarseRuns
from cwmav_rbdo.kriging import Kriging

Array = NDArray[np.float64]

POWER_FLOOR = 0.5
"""Least credible power, as a fraction of the smallest one in the samples."""


class RatioSurrogate(Protocol):
    """What the loop needs of a surrogate of L/P."""

    def fit(
        self,
        X: ArrayLike,
        lift: ArrayLike,
        power: ArrayLike,
        lift_variance: ArrayLike | None = None,
        power_variance: ArrayLike | None = None,
    ) -> Self:
        """Fit to samples X (n, d), lift (n,) in N, power (n,) in W and the variances of both."""
        ...

    def predict(self, X: ArrayLike) -> tuple[Array, Array]:
        """Return mean and standard deviation of L/P, (m,) each, N/W."""
        ...

    def mean(self, X: ArrayLike) -> Array:
        """Return the mean alone, cheaper."""
        ...

    def mse(self, X: ArrayLike) -> Array:
        """Return the mean square error, the square of the standard deviation."""
        ...

    def gradient(self, X: ArrayLike) -> Array:
        """Return the gradient of the mean, (m, d)."""
        ...

    def believe(self, X: Array) -> None:
        """Take the prediction at X (m, d) for answers (Kriging believer), so that the error falls there."""
        ...


def _checked_power(power: ArrayLike) -> Array:
    values = np.asarray(power, dtype=np.float64)
    wrong = ~(np.isfinite(values) & (values > 0.0))
    if np.any(wrong):
        raise InputError(
            f"power: {values[wrong].flat[0]} W in sample {int(np.argmax(wrong))}; must be finite and > 0"
        )
    return values


class LiftToPower:
    """Ratio of a lift and a power Kriging, its error propagated to first order (delta method).

    With lift L +- s_L and power P +- s_P independent, ``g = L / P`` has ``s_g^2 = (s_L^2 + g^2 s_P^2) /
    P^2``.

    Far from all samples a Kriging of the power can come near zero, where the ratio means nothing. Below
    half the smallest power of the samples the prediction is held there, and the distance counts as
    additional error.

    Parameters
    ----------
    lift, power : Kriging, optional; the lift may also be a co-kriging
        Settings of the two; clones of them are fitted.

    Attributes
    ----------
    lift_, power_ : Kriging
        Fitted.
    power_floor_ : float
        W.
    """

    def __init__(self, lift: Kriging | WithCoarseRuns | None = None, power: Kriging | None = None) -> None:
        self.lift = lift or Kriging()
        self.power = power or Kriging()

    def fit(
        self,
        X: ArrayLike,
        lift: ArrayLike,
        power: ArrayLike,
        lift_variance: ArrayLike | None = None,
        power_variance: ArrayLike | None = None,
    ) -> Self:
        """Fit both surrogates.

        Parameters
        ----------
        X : (n, d) array
        lift : (n,) array, N
        power : (n,) array, W
        lift_variance, power_variance : (n,) arrays, optional
            Squared standard uncertainties of the samples.

        Raises
        ------
        InputError
            As :meth:`Kriging.fit`; a power that is not positive.
        """
        checked = _checked_power(power)
        self.lift_ = clone(self.lift).fit(X, lift, lift_variance)
        self.power_ = clone(self.power).fit(X, checked, power_variance)
        self.power_floor_ = POWER_FLOOR * float(checked.min())
        return self

    def add(
        self,
        X: ArrayLike,
        lift: ArrayLike,
        power: ArrayLike,
        lift_variance: ArrayLike | None = None,
        power_variance: ArrayLike | None = None,
    ) -> Self:
        """Add samples without estimating the length scales anew (see :meth:`Kriging.add`)."""
        checked = _checked_power(power)
        self.lift_.add(X, lift, lift_variance)
        self.power_.add(X, checked, power_variance)
        self.power_floor_ = min(self.power_floor_, POWER_FLOOR * float(checked.min()))
        return self

    def predict(self, X: ArrayLike) -> tuple[Array, Array]:
        """Return mean and standard deviation of L/P at X (m, d); (m,) each, N/W."""
        lift, lift_mse = self.lift_.predict(X, return_mse=True)
        power, power_mse = self.power_.predict(X, return_mse=True)
        held = np.maximum(power, self.power_floor_)
        power_mse = power_mse + (held - power) ** 2
        ratio = lift / held
        return ratio, np.sqrt(lift_mse + ratio**2 * power_mse) / held

    def mean(self, X: ArrayLike) -> Array:
        """Return the mean of L/P alone; (m,), N/W."""
        return np.asarray(self.lift_.predict(X) / np.maximum(self.power_.predict(X), self.power_floor_))

    def mse(self, X: ArrayLike) -> Array:
        """Return the mean square error of L/P; (m,)."""
        return np.asarray(self.predict(X)[1] ** 2)

    def gradient(self, X: ArrayLike) -> Array:
        """Return the gradient of the mean of L/P; (m, d), N/W per unit of each variable."""
        lift, power = self.lift_.predict(X), self.power_.predict(X)
        free = power > self.power_floor_
        held = np.where(free, power, self.power_floor_)
        through_power = np.where(free, lift / held**2, 0.0)
        gradient: Array = self.lift_.gradient(X) / held[:, None]
        gradient -= through_power[:, None] * self.power_.gradient(X)
        return gradient

    def believe(self, X: Array) -> None:
        """Take the prediction at X (m, d) for answers."""
        self.add(X, self.lift_.predict(X), np.maximum(self.power_.predict(X), self.power_floor_))


class DirectRatio:
    """One Kriging of the ratios of the samples: the third surrogate of the paper's reading.

    Attributes
    ----------
    ratio_ : Kriging
        Fitted.
    """

    def __init__(self, ratio: Kriging | None = None) -> None:
        self.ratio = ratio or Kriging()

    def fit(
        self,
        X: ArrayLike,
        lift: ArrayLike,
        power: ArrayLike,
        lift_variance: ArrayLike | None = None,
        power_variance: ArrayLike | None = None,
    ) -> Self:
        """Fit to the ratios, with propagated variances; see :meth:`LiftToPower.fit`."""
        ratio, variance = _ratio(lift, power, lift_variance, power_variance)
        self.ratio_ = clone(self.ratio).fit(X, ratio, variance)
        return self

    def add(
        self,
        X: ArrayLike,
        lift: ArrayLike,
        power: ArrayLike,
        lift_variance: ArrayLike | None = None,
        power_variance: ArrayLike | None = None,
    ) -> Self:
        """Add samples without estimating the length scales anew."""
        ratio, variance = _ratio(lift, power, lift_variance, power_variance)
        self.ratio_.add(X, ratio, variance)
        return self

    def predict(self, X: ArrayLike) -> tuple[Array, Array]:
        """Return mean and standard deviation of L/P at X (m, d); (m,) each, N/W."""
        mean, std = self.ratio_.predict(X, return_std=True)
        return mean, std

    def mean(self, X: ArrayLike) -> Array:
        """Return the mean of L/P alone; (m,), N/W."""
        return np.asarray(self.ratio_.predict(X))

    def mse(self, X: ArrayLike) -> Array:
        """Return the mean square error of L/P; (m,)."""
        return np.asarray(self.ratio_.predict(X, return_mse=True)[1])

    def gradient(self, X: ArrayLike) -> Array:
        """Return the gradient of the mean of L/P; (m, d)."""
        gradient: Array = self.ratio_.gradient(X)
        return gradient

    def believe(self, X: Array) -> None:
        """Take the prediction at X (m, d) for answers."""
        self.add(X, self.mean(X), np.ones(len(X)))


def _ratio(
    lift: ArrayLike, power: ArrayLike, lift_variance: ArrayLike | None, power_variance: ArrayLike | None
) -> tuple[Array, Array | None]:
    checked = _checked_power(power)
    ratio = np.asarray(lift, dtype=np.float64) / checked
    if lift_variance is None and power_variance is None:
        return ratio, None
    of_lift = np.zeros(1) if lift_variance is None else np.asarray(lift_variance, dtype=np.float64)
    of_power = np.zeros(1) if power_variance is None else np.asarray(power_variance, dtype=np.float64)
    return ratio, (of_lift + ratio**2 * of_power) / checked**2
