# SPDX-License-Identifier: Apache-2.0
"""Least value of an expensive function in a box: expected improvement on Kriging.

The method is that of Jones, Schonlau and Welch (1998, J. Global Optim. 13:455): sample where the expected
improvement is largest; when it has become small, where the surrogate itself has its least value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_rbdo.general.oracle import Oracle
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.infill import expected_improvement
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.sampling import latin_hypercube
from cwmav_rbdo.swarm import PyswarmsSwarm, SwarmSettings

Array = NDArray[np.float64]
_SWARM = SwarmSettings(particles=200, iterations=200, patience=30)
_SMALL = 1e-4  # expected improvement, relative to the spread of the values, that counts as none
_RESTS = 2  # rounds without improvement before the end


@dataclass(frozen=True)
class Least:
    """Best point found, its value, the history of the best value, and whether the search came to rest."""

    x: Array
    f: float
    history: tuple[float, ...]
    converged: bool


def solve_global(problem: GeneralProblem, oracle: Oracle, rng: np.random.Generator) -> Least:
    """Minimise the objective of a problem of kind ``global`` within its budget.

    Raises
    ------
    WorkError
        Too few points could be evaluated.
    """
    lower, upper = problem.lower, problem.upper
    d = len(lower)
    count = min(max(4, oracle.budget // 3), 6 * d + 4)
    first = oracle(latin_hypercube(count, lower, upper, rng), "initial")
    X, y = first.points, first.values[:, 0] if len(first.values) else np.zeros(0)
    if len(y) < d + 2:
        raise WorkError(f"only {len(y)} of {count} points could be evaluated, too few for a surrogate")
    swarm, history, rests = PyswarmsSwarm(_SWARM), [float(y.min())], 0
    while oracle.left > 0 and rests < _RESTS:
        model = Kriging(problem.surrogate.kernel, problem.surrogate.trend).fit(X, y)
        best = float(y.min())
        start = X[[int(np.argmin(y))]]

        def no_improvement(P: Array, model: Kriging = model, best: float = best) -> Array:
            mean, std = model.predict(P, return_std=True)
            return -expected_improvement(-mean, std, -best)

        found = swarm.minimise(no_improvement, lower, upper, rng)
        small = -found.f <= _SMALL * float(np.ptp(y))
        if small:
            found = swarm.minimise(_prediction(model), lower, upper, rng, start)
        if np.any(np.all(np.abs(X - found.x) <= 1e-6 * (upper - lower), axis=1)):
            break
        answers = oracle(found.x[None], "least predicted" if small else "largest expected improvement")
        if len(answers.points):
            X, y = np.vstack([X, answers.points]), np.append(y, answers.values[:, 0])
        gained = best - float(y.min())
        rests = rests + 1 if small and gained <= _SMALL * float(np.ptp(y)) else 0
        history.append(float(y.min()))
    k = int(np.argmin(y))
    return Least(X[k], float(y[k]), tuple(history), oracle.left > 0)


def _prediction(model: Kriging) -> Callable[[Array], Array]:
    return lambda P: np.asarray(model.predict(P))
