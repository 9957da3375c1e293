# SPDX-License-Identifier: Apache-2.0
"""Least objective under probabilistic constraints, on Kriging models refined where it matters.

Each round: optimum on the surrogates (:mod:`cwmav_rbdo.general.design`), new samples at the worst points of
the active constraints and where the sign of a constraint is in doubt; when neither asks for any, at worst
points seen from designs nearby. It ends when the design does not move and none of the three asks for more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from cwmav_common.errors import WorkError
from cwmav_rbdo.general.design import Design, DesignSearch, neighbourhood
from cwmav_rbdo.general.largest_error import paper_samples
from cwmav_rbdo.general.oracle import BudgetSpentError, Oracle
from cwmav_rbdo.general.surrogates import CAUTION, Surrogates
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.result import Band, Constraint
from cwmav_rbdo.sampling import latin_hypercube

Array = NDArray[np.float64]

_POPULATION = 20_000  # points whose sign is asked for in every round
_FINAL = 1_000_000  # points of the Monte Carlo at the end
_BLOCK = 50_000
_DOUBT = 0.03  # share of wrong signs, relative to the allowed failures, that ends the refinement
_STILL = 2e-3  # relative change of objective, and of the design over its range, that counts as none
_K = 1.96
_NEAR = 0.02
"""Share of the ranges around a design within which the active constraints have to be known."""
_SLOPE_SURE = 0.03
"""Error there, in reliability indices, that is small enough: the slopes of the constraints rest on it."""
_SURE = 0.01
"""Error of a surrogate at a worst point, in reliability indices, below which no sample is spent there."""


@dataclass(frozen=True)
class Round:
    """One row of the history."""

    iteration: int
    design: Array
    objective: float
    violation: float
    doubt: tuple[float, ...]
    evaluations: int


@dataclass(frozen=True)
class Outcome:
    """Design found with its constraints, history and whether the rounds came to rest."""

    design: Design
    constraints: tuple[Constraint, ...]
    rounds: tuple[Round, ...]
    converged: bool
    message: str


@dataclass(frozen=True)
class Refined:
    """Design found, before its check, with the surrogates it was found on."""

    design: Design
    rounds: tuple[Round, ...]
    converged: bool
    message: str
    space: RandomSpace
    surrogates: Surrogates


def solve_rbdo(
    problem: GeneralProblem,
    oracle: Oracle,
    rng: np.random.Generator,
    go_on: Callable[[Array, float, int], bool] = lambda design, objective, evaluations: True,
) -> Outcome:
    """Solve a problem of kind ``rbdo`` and check the design by Monte Carlo on the surrogates.

    Parameters
    ----------
    problem : what to solve
    oracle : evaluates all constraints at rows of ``RandomSpace(problem).names``
    rng : source of randomness
    go_on : told design, objective and evaluations of every round; whether to begin another

    Raises
    ------
    WorkError
        Too few points could be evaluated for a surrogate.
    """
    found = refine(problem, oracle, rng, go_on)
    constraints = check(problem, found.space, found.surrogates, found.design.d, rng)
    return Outcome(found.design, constraints, found.rounds, found.converged, found.message)


def refine(
    problem: GeneralProblem,
    oracle: Oracle,
    rng: np.random.Generator,
    go_on: Callable[[Array, float, int], bool],
) -> Refined:
    """Take samples until the design comes to rest; see :func:`solve_rbdo`."""
    space = RandomSpace(problem)
    lower, upper = space.box(problem.lower, problem.upper)
    count = min(max(oracle.budget // 3, 4), 4 * len(lower) + 6)
    first = oracle(latin_hypercube(count, lower, upper, rng), "initial")
    if len(first.points) < len(lower) + 2:
        raise WorkError(
            f"only {len(first.points)} of {count} points could be evaluated, too few for {len(lower)} "
            f"variables; the first reason: {(oracle.excluded or ['none'])[0]}"
        )
    surrogates = Surrogates(problem.surrogate, first.points, first.values)
    search = DesignSearch(problem, space, surrogates, rng)
    population = rng.standard_normal((_POPULATION, space.dimension))
    rounds: list[Round] = []
    message = "design and reliabilities came to rest"
    while True:
        design = search.optimum()
        doubt, doubtful = _doubts(problem, space, surrogates, design, population)
        rounds.append(
            Round(
                len(rounds), design.d, design.objective, design.violation, tuple(doubt.tolist()), oracle.calls
            )
        )
        if not go_on(design.d, design.objective, oracle.calls):
            message = "stopped on request"
            break
        if problem.method == "default":
            rest = _at_rest(problem, rounds)
            points = _new_points(space, surrogates, design, doubt, doubtful, upper - lower)
            if rest or len(points) == 0:
                points = _beside(problem, space, surrogates, design, upper - lower)
                if rest and len(points) == 0:
                    break
        else:
            points = paper_samples(problem, space, surrogates, design, rng)
        if len(points) == 0:
            message = "no point is left that could tell more"
            break
        try:
            answers = oracle(points, "worst and doubtful points")
        except BudgetSpentError:
            message = f"stopped at max_true_evaluations {oracle.budget}"
            break
        if len(answers.points):
            surrogates.add(answers.points, answers.values)
    converged = not message.startswith("stopped") and design.violation <= 0.0
    return Refined(design, tuple(rounds), converged, message, space, surrogates)


def check(
    problem: GeneralProblem, space: RandomSpace, surrogates: Surrogates, d: Array, rng: np.random.Generator
) -> tuple[Constraint, ...]:
    """Monte Carlo of every constraint on its surrogate at a design, with the band of its error."""
    failures = np.zeros((len(surrogates.models), 3))
    for first in range(0, _FINAL, _BLOCK):
        X = space.physical(rng.standard_normal((min(_BLOCK, _FINAL - first), space.dimension)), d)
        for k in range(len(surrogates.models)):
            mean, std = surrogates.predict(k, X)
            failures[k] += [np.count_nonzero(mean + shift * std <= 0.0) for shift in (0.0, -_K, _K)]
    found = []
    for k, (middle, most, least) in enumerate(failures / _FINAL):
        error = np.sqrt(max(middle * (1.0 - middle), 1.0 / _FINAL) / _FINAL)
        band = Band(1.0 - middle, float(error), 1.0 - most, 1.0 - least, "monte_carlo on the surrogate")
        target = float(ndtr(problem.beta_targets[k]))
        found.append(Constraint(problem.constraints[k], band, target))
    return tuple(found)


def _doubts(
    problem: GeneralProblem, space: RandomSpace, surrogates: Surrogates, design: Design, population: Array
) -> tuple[Array, list[Array]]:
    """Give expected wrong signs over allowed failures of each constraint, and its most doubtful point."""
    X = space.physical(population, design.d)
    doubt, points = [], []
    for k, beta in enumerate(problem.beta_targets):
        mean, std = surrogates.predict(k, X)
        sureness = np.abs(mean) / np.maximum(CAUTION * std, 1e-300)
        doubt.append(float(np.mean(ndtr(-sureness)) / ndtr(-beta)))
        points.append(X[int(np.argmin(sureness))])
    return np.array(doubt), points


def _new_points(
    space: RandomSpace,
    surrogates: Surrogates,
    design: Design,
    doubt: Array,
    doubtful: list[Array],
    span: Array,
) -> Array:
    """Worst points of the constraints near their limit, then the most doubtful ones; none twice."""
    kept: list[Array] = []

    def take(x: Array) -> None:
        known = surrogates.near(x, span) or any(np.all(np.abs(x - y) <= 0.01 * span) for y in kept)
        if not known:
            kept.append(x)

    for k in np.flatnonzero(design.active).tolist():
        x = space.physical(design.worst[k][None], design.d)[0]
        if design.uncertainty[k] > _SURE:
            take(x)
    for k in np.argsort(-doubt).tolist():
        if doubt[k] > _DOUBT and len(kept) <= np.count_nonzero(design.active):
            take(doubtful[k])
    return np.array(kept)


def _beside(
    problem: GeneralProblem, space: RandomSpace, surrogates: Surrogates, design: Design, span: Array
) -> Array:
    """Give the least known worst point of each active constraint at designs nearby; (at most K, D).

    An optimum between constraints that cross at a small angle moves a long way for a small error of their
    slopes, which samples at the optimum itself do not show.
    """
    kept: list[Array] = []
    around = neighbourhood(problem, design.d, _NEAR)
    for k in np.flatnonzero(design.active).tolist():
        X = space.physical(np.tile(design.worst[k], (len(around), 1)), around)
        error = 2.0 * CAUTION * surrogates.predict(k, X)[1] / design.slope[k]
        x = X[int(np.argmax(error))]
        known = surrogates.near(x, span) or any(np.all(np.abs(x - y) <= 0.01 * span) for y in kept)
        if float(np.max(error)) > _SLOPE_SURE and not known:
            kept.append(x)
    return np.array(kept)


def _at_rest(problem: GeneralProblem, rounds: list[Round]) -> bool:
    if len(rounds) < 2 or max(rounds[-1].doubt) > _DOUBT:
        return False
    now, before = rounds[-1], rounds[-2]
    moved = np.max(np.abs(now.design - before.design) / (problem.upper - problem.lower))
    changed = abs(now.objective - before.objective) / max(abs(before.objective), 1e-12)
    return bool(moved <= _STILL and changed <= _STILL)
