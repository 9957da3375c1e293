# SPDX-License-Identifier: Apache-2.0
"""Where the next samples go. One function per method; :func:`new_samples` looks the method up.

``zhang2026`` takes the point of largest Kriging error (Eq. 20) in the whole space and that in the moving
window (Eq. 11); ``classical`` takes the first alone. A rule of your own is named in the problem file as
``method: python:package.module:function``.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cwmav_rbdo.control_scatter import ControlScatter
from cwmav_rbdo.goals import goal_of
from cwmav_rbdo.lift_to_power import RatioSurrogate
from cwmav_rbdo.optimum import Optimum, first_order_spread
from cwmav_rbdo.plugins import resolve
from cwmav_rbdo.samples import Samples
from cwmav_rbdo.swarm import swarm_of
from cwmav_rbdo.window import Window
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]

FIXED_SIZE = ("zhang2026", "classical")
"""Methods of the paper: they propose what the paper says and stop by CC1 and CC2."""


_APART = 5e-3
"""Of the ranges: points of one round that are closer tell the same."""
_SAME = 1e-4
"""The same for the methods of the paper, which knows no such rule: only what is one point is one."""


@dataclass(frozen=True)
class State:
    """What an infill rule may look at; the surface already knows the evaluation at the optimum."""

    surface: RatioSurrogate
    problem: WingProblem
    scatter: ControlScatter
    optimum: Optimum
    window: Window
    samples: Samples
    rng: np.random.Generator
    count: int
    """Points that can be evaluated at the same time; a rule may propose more or fewer."""
    iteration: int = 0
    """Rounds before this one."""


@dataclass(frozen=True)
class Candidate:
    """A proposed sample (d,), why, and the improvement expected there, relative to the optimum."""

    x: Array
    reason: str
    promise: float = float("nan")


class Rule(Protocol):
    """Proposes samples."""

    def __call__(self, state: State) -> list[Candidate]:
        """Give points inside the bounds; those that are samples already are left out afterwards."""
        ...


def new_samples(state: State) -> tuple[list[Candidate], float]:
    """Propose samples by the rule of ``problem.method``.

    Returns
    -------
    candidates : list
        Without those that could tell nothing new or are proposed twice.
    promise : float
        Largest expected improvement the rule saw; NaN where it looked for none.
    """
    problem = state.problem
    proposed = resolve(problem.method, RULES, "method")(state)
    apart = _SAME if problem.method in FIXED_SIZE else _APART
    kept: list[Candidate] = []
    for candidate in proposed:
        x = np.clip(candidate.x, problem.lower, problem.upper)
        near = [c for c in kept if np.all(np.abs(x - c.x) <= apart * (problem.upper - problem.lower))]
        if not near and not _known(state, state.surface, x):
            kept.append(Candidate(x, candidate.reason, candidate.promise))
    promises = [c.promise for c in proposed if np.isfinite(c.promise)]
    return kept, max(promises, default=float("nan"))


def zhang2026(state: State) -> list[Candidate]:
    """Largest error in the space and in the window: the paper's accelerated Kriging."""
    window = state.window
    x, _ = largest_mse(state.surface, state.problem, window.lower, window.upper, state.rng)
    return [*classical(state), Candidate(x, "largest error in the window")]


def classical(state: State) -> list[Candidate]:
    """Largest error in the space: the paper's comparison."""
    problem = state.problem
    x, _ = largest_mse(state.surface, problem, problem.lower, problem.upper, state.rng)
    return [Candidate(x, "largest error")]


def default(state: State) -> list[Candidate]:
    """In turn: largest error where the scatter will be, and largest expected improvement in the space.

    The point of largest error nearly always lies in a corner of the space, where the ratio is far from its
    best and a sample says nothing about the optimum. Expected improvement looks far away too, but only where
    the optimum could be (Jones, Schonlau and Welch 1998, J. Global Optim. 13:455). Near the optimum the error
    counts by the density of the scatter there, blurred by the window, which says how far the optimum may
    still move. Beside a sample whose own error is larger than that of the surface no other is taken: its
    answer would carry the same error again. Every point of a round is chosen as if the ones before had been
    answered as predicted; where points are evaluated one by one, a round has one, because the next is chosen
    better when it is answered.
    """
    surface, promise = deepcopy(state.surface), _promising(state, state.surface).promise
    found: list[Candidate] = []
    for k in range(state.count):
        turns = [_under_scatter, _promising]
        if (state.iteration * state.count + k) % 2:
            turns.reverse()
        candidate = turns[0](state, surface)
        if _known(state, surface, candidate.x):
            candidate = turns[1](state, surface)
        found.append(candidate)
        surface.believe(candidate.x[None])
    return [replace(candidate, promise=promise) for candidate in found]


RULES: Mapping[str, Rule] = {"zhang2026": zhang2026, "classical": classical, "default": default}


def expected_improvement(mean: Array, std: Array, best: float) -> Array:
    """Give the expected amount by which a normal prediction exceeds `best`; (n,)."""
    gain = mean - best
    safe = np.where(std > 0.0, std, 1.0)
    z = gain / safe
    value = gain * ndtr(z) + std * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    return np.where(std > 0.0, value, np.maximum(gain, 0.0))


def largest_mse(
    surface: RatioSurrogate,
    problem: WingProblem,
    lower: Array,
    upper: Array,
    rng: np.random.Generator,
) -> tuple[Array, float]:
    """Point (d,) of the largest Kriging mean square error (Eq. 20) in a box, and that error."""
    found = swarm_of(problem.optimiser, problem.swarm).minimise(lambda X: -surface.mse(X), lower, upper, rng)
    return found.x, -found.f


def _known(state: State, surface: RatioSurrogate, x: Array) -> bool:
    """Whether an evaluation at `x` could tell nothing new."""
    if state.samples.hold(x):
        return True
    beside = state.samples.response_at(x, _APART)
    if beside is None or state.problem.method in FIXED_SIZE:
        return False
    return bool(surface.predict(x[None])[1][0] < beside.lift_to_power_std)


def _promising(state: State, surface: RatioSurrogate) -> Candidate:
    problem, goal = state.problem, goal_of(state.problem)
    best = float(goal.predict(surface, state.optimum.x[None])[0][0])
    held = goal.margin(surface, 0.0)
    spread = first_order_spread(held, problem.lower, problem.upper, state.scatter)

    def worse(X: Array) -> Array:
        gain: Array = expected_improvement(*goal.predict(surface, X), best)
        if goal.constrained and goal.sign < 0.0:  # the requirement is about something else than the objective
            margin, low = held(X), goal.margin(surface, 0.0, -1.0)(X)
            needed = float(ndtri(problem.require.reliability)) * spread(X)
            gain = gain * ndtr((margin - needed) / np.maximum(margin - low, 1e-12))
        return np.asarray(-gain)

    found = swarm_of(problem.optimiser, problem.swarm).minimise(
        worse, problem.lower, problem.upper, state.rng
    )
    return Candidate(found.x, "largest expected improvement", -found.f / max(abs(best), 1e-12))


def _under_scatter(state: State, surface: RatioSurrogate) -> Candidate:
    window, centre = state.window, state.optimum.x
    std = state.scatter(centre[None])[0]
    reach = np.sqrt(std**2 + ((window.upper - window.lower) / 6.0) ** 2)

    def weighted(X: Array) -> Array:
        weight = np.exp(-0.5 * np.sum(((X - centre) / reach) ** 2, axis=1))
        return np.asarray(-surface.mse(X) * weight)

    found = swarm_of(state.problem.optimiser, state.problem.swarm).minimise(
        weighted, window.lower, window.upper, state.rng
    )
    return Candidate(found.x, "largest error under the scatter")
