# SPDX-License-Identifier: Apache-2.0
"""The best design under the reliability constraint, on surrogates (Eqs. 6 and 14).

A swarm looks the reliability of its particles up in a field computed once for the whole space; a gradient
polish from what it found uses the exact quadrature. So the constraint is decided by the exact value, and the
swarm costs no more than the prediction of the ratio.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cwmav_rbdo.control_scatter import ControlScatter
from cwmav_rbdo.goals import Function, Goal, goal_of
from cwmav_rbdo.lift_to_power import RatioSurrogate
from cwmav_rbdo.polish import polish
from cwmav_rbdo.ratio_margin import LiftMargin, RatioMargin
from cwmav_rbdo.reliability import ConvolvedField
from cwmav_rbdo.result import Band
from cwmav_rbdo.swarm import swarm_of
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]
FailureProbability = Callable[[Array], Array]

# Share of the allowed failures kept back: an optimiser ends within its tolerance on either side of its aim.
_RESERVE = 1e-3
_INFEASIBLE = 1e3  # far above any value, so every feasible particle ranks before every infeasible one
_K = 1.96  # standard deviations of the band that the surrogate's error leaves
_NEARBY = (100, 60)  # particles and iterations of the small swarm
_LARGEST_BETA = 8.0  # reliability indices beyond are rounding
_DIFFERENCE = 1e-3  # of the ranges, for slopes of the margin
_FIELD_POINTS = 2_000_000  # grid points of the field beyond which its step grows


@dataclass(frozen=True)
class Optimum:
    """A design with its value for the goal, its predicted ratio [N/W] and its reliability."""

    x: Array
    value: float
    """What the goal maximises, at `x`."""
    prediction: float
    prediction_std: float
    reliability: Band
    feasible: bool


def reliable_optimum(
    surface: RatioSurrogate,
    problem: WingProblem,
    scatter: ControlScatter,
    rng: np.random.Generator,
) -> Optimum:
    """Find the best design for the goal of the problem among those that hold its requirement.

    Parameters
    ----------
    surface : fitted surrogate of L/P
    problem : bounds, goal, requirement, swarm settings
    scatter : of the design variables
    rng : source of randomness

    Returns
    -------
    Optimum
        Where no design holds the requirement: the most reliable one found, with ``feasible`` false.
    """
    goal = goal_of(problem)
    lower, upper = problem.lower, problem.upper
    allowed = 1.0 - problem.require.reliability
    limit_state = goal.margin(surface, 0.0)

    def exact(X: Array) -> Array:
        return scatter.failure(limit_state, X)[0] if goal.constrained else np.zeros(len(X))

    quick, value = goal.quick(surface, scatter), goal.value(surface, scatter)
    screen = _screen(limit_state, lower, upper, scatter) if goal.constrained else exact
    swarm = swarm_of(problem.optimiser, problem.swarm)
    found = swarm.minimise(_ranking(quick, screen, allowed), lower, upper, rng).x
    aim = (1.0 - _RESERVE) * allowed
    polished = _polished(value, exact, aim, problem, found)
    if float(exact(polished[None, :])[0]) > allowed:
        polished = _searched_nearby(quick, exact, aim, problem, found, scatter, rng)
    mean, error = surface.predict(polished[None, :])
    best = float(value(polished[None, :])[0])
    band = reliability_band(surface, goal, polished, best, scatter)
    feasible = not goal.constrained or band.value >= problem.require.reliability
    return Optimum(polished, best, float(mean[0]), float(error[0]), band, feasible)


def _polished(
    value: Function, exact: FailureProbability, allowed: float, problem: WingProblem, start: Array
) -> Array:
    """Gradient polish under the exact constraint, written in reliability indices, which keep a slope."""
    target = -ndtri(allowed)

    def margin(X: Array) -> Array:
        return np.asarray(np.clip(-ndtri(exact(X)), -_LARGEST_BETA, _LARGEST_BETA) - target)

    return polish(lambda X: -value(X), problem.lower, problem.upper, start, [margin]).x


def _searched_nearby(
    value: Function,
    exact: FailureProbability,
    allowed: float,
    problem: WingProblem,
    start: Array,
    scatter: ControlScatter,
    rng: np.random.Generator,
) -> Array:
    """Small swarm with the exact constraint, where the gradient did not reach the feasible side."""
    reach = np.maximum(3.0 * scatter(start[None])[0], 0.01 * (problem.upper - problem.lower))
    small = replace(problem.swarm, particles=_NEARBY[0], iterations=_NEARBY[1], patience=15)
    swarm = swarm_of(problem.optimiser, small)
    lower, upper = np.maximum(problem.lower, start - reach), np.minimum(problem.upper, start + reach)
    return swarm.minimise(_ranking(value, exact, allowed), lower, upper, rng, start=start[None, :]).x


def reliability_band(
    surface: RatioSurrogate, goal: Goal, x: Array, value: float, scatter: ControlScatter
) -> Band:
    """Reliability of one design (Eq. 5) on the mean surface, and on those 1.96 errors below and above."""
    middle, low, high = (scatter.estimate(goal.margin(surface, value, k), x) for k in (0.0, -_K, _K))
    return Band(middle.reliability, middle.std, low.reliability, high.reliability, middle.method)


def _screen(
    g: RatioMargin | LiftMargin, lower: Array, upper: Array, scatter: ControlScatter
) -> FailureProbability:
    """Failure probability that is cheap enough for a swarm.

    A field over the whole space where the scatter is normal, independent and the same everywhere; else the
    first order of the margin and its slope.
    """
    std = scatter.constant
    if std is None or not scatter.normal or len(std) > 3 or not np.all(std > 0):
        return _first_order(g, lower, upper, scatter)
    step = 0.7
    while step < 1.2 and np.prod((upper - lower + 9.0 * std) / (step * std)) > _FIELD_POINTS:
        step += 0.1
    return ConvolvedField(g, lower, upper, std, step=min(step, 1.2)).failure_probability


def first_order_spread(
    g: RatioMargin | LiftMargin, lower: Array, upper: Array, scatter: ControlScatter
) -> Function:
    """Give the standard deviation of a margin under the scatter, to first order, as a function of designs."""
    steps = np.diag(_DIFFERENCE * (upper - lower))

    def spread(X: Array) -> Array:
        slopes = [(g(X + h) - g(X - h)) / (2.0 * h.sum()) for h in steps]
        return scatter.spread(np.stack(slopes, axis=1), X)

    return spread


def _first_order(
    g: RatioMargin | LiftMargin, lower: Array, upper: Array, scatter: ControlScatter
) -> FailureProbability:
    spread_at = first_order_spread(g, lower, upper, scatter)

    def failure(X: Array) -> Array:
        margin, spread = g(X), spread_at(X)
        sure = spread <= 0.0
        return np.asarray(np.where(sure, margin <= 0.0, ndtr(-margin / np.where(sure, 1.0, spread))))

    return failure


def _ranking(value: Function, failure: FailureProbability, allowed: float) -> Function:
    """Value to minimise: the negative one where feasible, the failure probability elsewhere."""

    def ranked(X: Array) -> Array:
        best, pf = value(X), failure(X)
        return np.where(pf <= allowed, -best, _INFEASIBLE * (1.0 + pf) - best)

    return ranked
