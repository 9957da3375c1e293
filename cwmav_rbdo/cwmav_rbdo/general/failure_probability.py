# SPDX-License-Identifier: Apache-2.0
"""Failure probability of a problem without design variables, by a surrogate that chooses its own samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_rbdo.general.oracle import Oracle
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.reliability.active_learning import LearningSettings, active_learning
from cwmav_rbdo.reliability.estimate import Estimate

Array = NDArray[np.float64]


class _Physical:
    """The random vector of the problem as the reliability methods want it."""

    def __init__(self, space: RandomSpace) -> None:
        self._space = space
        self.dimension = space.dimension

    def from_standard(self, U: Array) -> Array:
        """Map standard normal points (n, m) to physical rows."""
        return self._space.physical(U, np.zeros((len(U), 0)))


def solve_reliability(problem: GeneralProblem, oracle: Oracle, rng: np.random.Generator) -> Estimate:
    """Estimate the probability that any constraint fails.

    Parameters
    ----------
    problem : of kind ``reliability``
    oracle : evaluates all constraints at rows of the random variables
    rng : source of randomness

    Returns
    -------
    Estimate
        Of the series system of all constraints: failed where the smallest one is <= 0.

    Raises
    ------
    WorkError
        The budget is spent, or a point could not be evaluated.
    """

    def g(X: Array) -> Array:
        answers = oracle(X, "limit state")
        if len(answers.points) < len(X):
            raise WorkError(f"a point could not be evaluated: {oracle.excluded[-1]}")
        return np.asarray(answers.values.min(axis=1))

    settings = LearningSettings(largest=oracle.budget)
    return active_learning(g, _Physical(RandomSpace(problem)), rng, settings)
