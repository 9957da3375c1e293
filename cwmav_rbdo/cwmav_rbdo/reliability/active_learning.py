# SPDX-License-Identifier: Apache-2.0
"""Probability of failure from few evaluations: Kriging that is taught where its sign is in doubt.

The idea is that of AK-MCS (Echard, Gayton and Lemaire 2011, Structural Safety 33:145): a large random
population is classified as failed or safe by a surrogate, and the limit state is evaluated where the
classification is least sure, at the least ``U = |mean| / std``. It ends not at a threshold on U but when the
expected number of wrong signs is a small part of the number of failures, which is what the estimate is about.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from cwmav_common.errors import InputError, WorkError
from cwmav_common.settings import setting
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.inputs import Inputs, LimitState, standard_limit_state

Array = NDArray[np.float64]

CERTAIN = 6.0
"""A sign this many standard deviations away from doubt is not looked at again until the next full refit."""
CAUTION = 3.0
"""Factor on the surrogate's standard deviation: with few samples it knows too little of its own error."""
SPREAD = 1.5
"""The first samples are drawn with the scatter widened by this, to reach the tails."""


@dataclass(frozen=True)
class LearningSettings:
    """How the surrogate is taught."""

    initial: int = setting(0, "first evaluations; 0: 12, or twice the coefficients of a linear trend", ge=0)
    largest: int = setting(1000, "evaluations at most", ge=4)
    population: int = setting(20_000, "random points classified while learning, at first", ge=1000)
    failures: int = setting(300, "failed points that the population grows to have", ge=10)
    largest_population: int = setting(1_000_000, "random points classified while learning, at most", ge=1000)
    final: int = setting(1_000_000, "random points of the final estimate", ge=1000)
    misclassified: float = setting(
        0.02, "end when expected wrong signs are this part of the failures", gt=0, lt=1
    )
    refit_share: float = setting(
        0.1, "new samples between two estimations of the length scales, as a part of all", ge=0, le=1
    )
    kernel: str = setting("gaussian", "correlation function", choices=("gaussian", "matern52"))


class UnsureError(WorkError):
    """The budget ended before the signs were sure enough; `estimate` is what there is."""

    def __init__(self, estimate: Estimate, message: str) -> None:
        super().__init__(message)
        self.estimate = estimate


def active_learning(
    g: LimitState, inputs: Inputs, rng: np.random.Generator, settings: LearningSettings | None = None
) -> Estimate:
    """Estimate a probability of failure with a surrogate that chooses its own samples.

    Parameters
    ----------
    g : callable
        The expensive limit state, called with one point (1, d) at a time after the first samples.
    inputs : Inputs
    rng : numpy.random.Generator
    settings : LearningSettings, optional

    Returns
    -------
    Estimate
        `evaluations` counts those of g. `std` joins the sampling error of the final population and the
        expected share of wrong signs.

    Raises
    ------
    UnsureError
        If the budget ends before the signs are sure enough; it carries the estimate so far.
    """
    s = settings or LearningSettings()
    d = inputs.dimension
    first = s.initial or max(12, 2 * (d + 1))
    if first >= s.largest:
        raise InputError(f"largest = {s.largest} leaves nothing after the first {first} evaluations")
    evaluate = standard_limit_state(g, inputs)
    U = SPREAD * ndtri(qmc.LatinHypercube(d, rng=rng).random(first))
    learner = _Learner(s, inputs, U, evaluate(U), rng.standard_normal((s.population, d)))
    while not (learner.sure() and learner.populous(rng)):
        if len(learner.values) >= s.largest:
            found = learner.estimate(rng)
            doubt = found.std / max(found.value, 1e-300)
            raise UnsureError(
                found,
                f"active learning: {s.largest} evaluations leave {doubt:.0%} doubt about the estimate "
                f"{found.value:.3g}",
            )
        point = learner.most_doubtful()
        learner.learn(point, evaluate(point))
    return learner.estimate(rng)


class _Learner:
    """Surrogate, population and what is known about its signs."""

    def __init__(
        self, settings: LearningSettings, inputs: Inputs, U: Array, values: Array, population: Array
    ):
        self.settings, self.inputs = settings, inputs
        self.X, self.values = inputs.from_standard(U), values
        self._settle(population)
        self._refit()

    def _settle(self, population: Array) -> None:
        self.population = population
        self.physical = self.inputs.from_standard(population)

    def _refit(self) -> None:
        self.model = Kriging(self.settings.kernel, "auto", starts=2).fit(self.X, self.values)
        self._age = 0
        self._caution = CAUTION * max(1.0, self.model.loo_standardised_)
        self._classify()

    def _classify(self) -> None:
        self.mean, self.std = self._predict(self.physical)
        self._doubtful = np.flatnonzero(np.abs(self.mean) < CERTAIN * self.std)

    def _predict(self, X: Array) -> tuple[Array, Array]:
        mean, std = self.model.predict(X, return_std=True)
        return np.asarray(mean), self._caution * np.asarray(std)

    def learn(self, point: Array, value: Array) -> None:
        """Take one evaluation (standard normal point) into the surrogate."""
        x = self.inputs.from_standard(point)
        self.X, self.values = np.vstack([self.X, x]), np.append(self.values, value)
        self._age += 1
        if self._age >= max(5.0, self.settings.refit_share * len(self.values)):
            self._refit()
            return
        self.model.add(x, value)
        self.mean[self._doubtful], self.std[self._doubtful] = self._predict(self.physical[self._doubtful])

    def sure(self) -> bool:
        """Whether the expected wrong signs are few beside the failures; a full refit must agree."""
        if self._share_of_wrong_signs() > self.settings.misclassified:
            return False
        if self._age:
            self._refit()
        return self._share_of_wrong_signs() <= self.settings.misclassified

    def populous(self, rng: np.random.Generator) -> bool:
        """Whether the population has enough failed points; if not, it is enlarged and classified."""
        n, largest = len(self.population), self.settings.largest_population
        if np.count_nonzero(self.mean <= 0.0) >= self.settings.failures or n >= largest:
            return True
        more = rng.standard_normal((min(4 * n, largest) - n, self.inputs.dimension))
        self._settle(np.vstack([self.population, more]))
        self._classify()
        return self.sure() and self.populous(rng)

    def _share_of_wrong_signs(self) -> float:
        wrong = float(np.sum(_chance_of_wrong_sign(self.mean, self.std)))
        return wrong / max(float(np.count_nonzero(self.mean <= 0.0)), 1.0)

    def most_doubtful(self) -> Array:
        """Point of the population (1, d) with the least U that is not a sample already."""
        doubt = np.where(self.std > 0.0, np.abs(self.mean) / np.where(self.std > 0.0, self.std, 1.0), np.inf)
        return self.population[[int(np.argmin(doubt))]]

    def estimate(self, rng: np.random.Generator) -> Estimate:
        """Classify a fresh population."""
        n, failed, wrong = self.settings.final, 0, 0.0
        for first in range(0, n, 100_000):
            size = min(100_000, n - first)
            U = rng.standard_normal((size, self.inputs.dimension))
            mean, std = self._predict(self.inputs.from_standard(U))
            failed += int(np.count_nonzero(mean <= 0.0))
            wrong += float(np.sum(_chance_of_wrong_sign(mean, std)))
        p = failed / n
        sampling = max(p, 1.0 / n) / n
        return Estimate(p, math.sqrt(sampling + (wrong / n) ** 2), len(self.values), "active_learning")


def _chance_of_wrong_sign(mean: Array, std: Array) -> Array:
    sure = std <= 0.0
    return np.asarray(np.where(sure, 0.0, ndtr(-np.abs(mean) / np.where(sure, 1.0, std))))
