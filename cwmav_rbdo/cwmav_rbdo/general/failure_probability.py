# SPDX-License-Identifier: Apache-2.0
"""Failure probability of a problem without design variables."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_rbdo.general.oracle import BudgetSpentError, Oracle
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.plugins import resolve
from cwmav_rbdo.reliability import (
    Estimate,
    Inputs,
    LearningSettings,
    LimitState,
    active_learning,
    form,
    importance_sampling,
    line_sampling,
    monte_carlo,
    subset_simulation,
)

Array = NDArray[np.float64]


class Method(Protocol):
    """Estimates the probability that a limit state is <= 0."""

    def __call__(self, g: LimitState, inputs: Inputs, rng: np.random.Generator) -> Estimate:
        """Evaluate g at physical points (n, d) as often as it takes; every row counts."""
        ...


class _Physical:
    """The random vector of the problem as the reliability methods want it."""

    def __init__(self, space: RandomSpace) -> None:
        self._space = space
        self.dimension = space.dimension

    def from_standard(self, U: Array) -> Array:
        """Map standard normal points (n, m) to physical rows."""
        return self._space.physical(U, np.zeros((len(U), 0)))


def solve_reliability(problem: GeneralProblem, oracle: Oracle, rng: np.random.Generator) -> Estimate:
    """Estimate the probability that any constraint fails, by the method that the problem names.

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

    method = resolve(problem.reliability_method, _methods(oracle.budget), "reliability_method")
    try:
        return method(g, _Physical(RandomSpace(problem)), rng)
    except BudgetSpentError as error:
        raise WorkError(
            f"{problem.reliability_method}: max_true_evaluations is too small ({error})"
        ) from None


def _methods(budget: int) -> dict[str, Method]:
    """Give the package's methods, each within a budget of evaluations."""
    half, eighth = max(10, budget // 2), max(20, budget // 8)  # searches and levels cost evaluations as well
    return {
        "active_learning": lambda g, inputs, rng: active_learning(
            g, inputs, rng, LearningSettings(largest=budget)
        ),
        "monte_carlo": lambda g, inputs, rng: monte_carlo(g, inputs, rng, budget),
        "importance_sampling": lambda g, inputs, rng: importance_sampling(g, inputs, rng, half),
        "subset_simulation": lambda g, inputs, rng: subset_simulation(g, inputs, rng, eighth),
        "line_sampling": lambda g, inputs, rng: line_sampling(g, inputs, rng, max(2, budget // 60)),
        "form": lambda g, inputs, rng: form(g, inputs),
    }
