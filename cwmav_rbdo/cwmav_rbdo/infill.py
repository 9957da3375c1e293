# SPDX-License-Identifier: Apache-2.0
"""Where the next samples go. One function per method; :func:`new_samples` looks the method up.

``zhang2026`` takes the point of largest Kriging error (Eq. 20) in the whole space and that in the moving
window (Eq. 11); ``classical`` takes the first alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower
from cwmav_rbdo.optimum import Optimum
from cwmav_rbdo.samples import Samples
from cwmav_rbdo.swarm import PyswarmsSwarm
from cwmav_rbdo.window import Window
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """What an infill rule may look at; the surface already knows the evaluation at the optimum."""

    surface: LiftToPower | DirectRatio
    problem: WingProblem
    optimum: Optimum
    window: Window
    samples: Samples
    rng: np.random.Generator


Candidate = tuple[Array, str]
Rule = Callable[[State], list[Candidate]]


def new_samples(state: State) -> list[Candidate]:
    """Propose samples with reasons by the rule of ``problem.method``; samples there already are left out."""
    problem = state.problem
    kept: list[Candidate] = []
    for x, reason in RULES[problem.method](state):
        near = [y for y, _ in kept if np.all(np.abs(x - y) <= 1e-4 * (problem.upper - problem.lower))]
        if not near and not state.samples.hold(x):
            kept.append((x, reason))
    return kept


def zhang2026(state: State) -> list[Candidate]:
    """Largest error in the space and in the window: the paper's accelerated Kriging."""
    return [_of_space(state), _of_window(state)]


def classical(state: State) -> list[Candidate]:
    """Largest error in the space: the paper's comparison."""
    return [_of_space(state)]


def default(state: State) -> list[Candidate]:
    """Largest expected improvement of L/P in the space, and largest error in the window.

    The point of largest error nearly always lies in a corner of the space, where the ratio is far from its
    best and a sample says nothing about the optimum. Expected improvement looks far away too, but only where
    the optimum could be (Jones, Schonlau and Welch 1998, J. Global Optim. 13:455).
    """
    best = state.optimum.prediction

    def worse(X: Array) -> Array:
        return -expected_improvement(*state.surface.predict(X), best)

    problem = state.problem
    swarm = PyswarmsSwarm(problem.swarm)
    promising = swarm.minimise(worse, problem.lower, problem.upper, state.rng).x
    return [(promising, "largest expected improvement"), _of_window(state)]


RULES: Mapping[str, Rule] = {"zhang2026": zhang2026, "classical": classical, "default": default}


def expected_improvement(mean: Array, std: Array, best: float) -> Array:
    """Give the expected amount by which a normal prediction exceeds `best`; (n,)."""
    gain = mean - best
    safe = np.where(std > 0.0, std, 1.0)
    z = gain / safe
    value = gain * ndtr(z) + std * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    return np.where(std > 0.0, value, np.maximum(gain, 0.0))


def _of_space(state: State) -> Candidate:
    problem = state.problem
    return largest_mse(state.surface, problem, problem.lower, problem.upper, state.rng)[0], "largest error"


def _of_window(state: State) -> Candidate:
    window = state.window
    x, _ = largest_mse(state.surface, state.problem, window.lower, window.upper, state.rng)
    return x, "largest error in the window"


def largest_mse(
    surface: LiftToPower | DirectRatio,
    problem: WingProblem,
    lower: Array,
    upper: Array,
    rng: np.random.Generator,
) -> tuple[Array, float]:
    """Point (d,) of the largest Kriging mean square error (Eq. 20) in a box, and that error."""
    found = PyswarmsSwarm(problem.swarm).minimise(lambda X: -surface.mse(X), lower, upper, rng)
    return found.x, -found.f
