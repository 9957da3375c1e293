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
from scipy.special import ndtri

from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower
from cwmav_rbdo.polish import polish
from cwmav_rbdo.ratio_margin import RatioMargin
from cwmav_rbdo.reliability import ConvolvedField, line_root, line_root_estimate
from cwmav_rbdo.result import Band
from cwmav_rbdo.swarm import PyswarmsSwarm
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]
FailureProbability = Callable[[Array], Array]

_INFEASIBLE = 1e3  # N/W; far above any ratio, so every feasible particle ranks before every infeasible one
_K = 1.96  # standard deviations of the band that the surrogate's error leaves
_NEARBY = (100, 60)  # particles and iterations of the small swarm
_LARGEST_BETA = 8.0  # reliability indices beyond are rounding
_FIELD_POINTS = 2_000_000  # grid points of the field beyond which its step grows


@dataclass(frozen=True)
class Optimum:
    """A design with its predicted ratio [N/W] and reliability."""

    x: Array
    prediction: float
    prediction_std: float
    reliability: Band
    feasible: bool


def reliable_optimum(
    surface: LiftToPower | DirectRatio, problem: WingProblem, std: Array, rng: np.random.Generator
) -> Optimum:
    """Maximise the predicted L/P over the designs that hold the requirement.

    Parameters
    ----------
    surface : fitted surrogate of L/P
    problem : bounds, requirement, swarm settings
    std : (d,) scatter of the design variables, in the units of the problem
    rng : source of randomness

    Returns
    -------
    Optimum
        Where no design holds the requirement: the most reliable one found, with ``feasible`` false.
    """
    limit_state = RatioMargin(surface, problem.require.lift_to_power)  # Eq. 14

    def exact(X: Array) -> Array:
        return line_root(limit_state, X, std)[0]

    lower, upper = problem.lower, problem.upper
    allowed = 1.0 - problem.require.reliability
    screen = _screen(limit_state, lower, upper, std) or exact
    swarm = PyswarmsSwarm(problem.swarm)
    found = swarm.minimise(_ranking(surface, screen, allowed), lower, upper, rng).x
    polished = _polished(surface, exact, allowed, problem, found)
    if float(exact(polished[None, :])[0]) > allowed:
        polished = _searched_nearby(surface, exact, allowed, problem, found, std, rng)
    mean, error = surface.predict(polished[None, :])
    band = reliability_band(surface, polished, std, problem.require.lift_to_power)
    return Optimum(polished, float(mean[0]), float(error[0]), band, band.value >= problem.require.reliability)


def _polished(
    surface: LiftToPower | DirectRatio,
    exact: FailureProbability,
    allowed: float,
    problem: WingProblem,
    start: Array,
) -> Array:
    """Gradient polish under the exact constraint, written in reliability indices, which keep a slope."""
    target = -ndtri(allowed)

    def margin(X: Array) -> Array:
        return np.asarray(np.clip(-ndtri(exact(X)), -_LARGEST_BETA, _LARGEST_BETA) - target)

    return polish(lambda X: -surface.mean(X), problem.lower, problem.upper, start, [margin]).x


def _searched_nearby(
    surface: LiftToPower | DirectRatio,
    exact: FailureProbability,
    allowed: float,
    problem: WingProblem,
    start: Array,
    std: Array,
    rng: np.random.Generator,
) -> Array:
    """Small swarm with the exact constraint, where the gradient did not reach the feasible side."""
    reach = np.maximum(3.0 * std, 0.01 * (problem.upper - problem.lower))
    swarm = PyswarmsSwarm(replace(problem.swarm, particles=_NEARBY[0], iterations=_NEARBY[1], patience=15))
    lower, upper = np.maximum(problem.lower, start - reach), np.minimum(problem.upper, start + reach)
    return swarm.minimise(_ranking(surface, exact, allowed), lower, upper, rng, start=start[None, :]).x


def reliability_band(surface: LiftToPower | DirectRatio, x: Array, std: Array, required: float) -> Band:
    """Reliability of one design (Eq. 5) on the mean surface, and on those 1.96 errors below and above."""
    middle, low, high = (
        line_root_estimate(RatioMargin(surface, required, k), x, std) for k in (0.0, -_K, _K)
    )
    return Band(middle.reliability, middle.std, low.reliability, high.reliability, middle.method)


def _screen(g: RatioMargin, lower: Array, upper: Array, std: Array) -> FailureProbability | None:
    """Field of the failure probability; None with more than three variables or without scatter."""
    if len(std) > 3 or not np.all(std > 0):
        return None
    step = 0.7
    while step < 1.2 and np.prod((upper - lower + 9.0 * std) / (step * std)) > _FIELD_POINTS:
        step += 0.1
    return ConvolvedField(g, lower, upper, std, step=min(step, 1.2)).failure_probability


def _ranking(
    surface: LiftToPower | DirectRatio, failure: FailureProbability, allowed: float
) -> Callable[[Array], Array]:
    """Value to minimise: -L/P where feasible; elsewhere the failure probability, ties broken by L/P."""

    def value(X: Array) -> Array:
        mean, pf = surface.mean(X), failure(X)
        return np.where(pf <= allowed, -mean, _INFEASIBLE * (1.0 + pf) - mean)

    return value
