# SPDX-License-Identifier: Apache-2.0
"""Surrogates of the lift-to-power ratio by the name that a problem file gives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cwmav_rbdo.coarse_runs import lift_surrogate
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower, RatioSurrogate
from cwmav_rbdo.plugins import resolve
from cwmav_rbdo.wing_problem import WingProblem


def surface_of(problem: WingProblem) -> RatioSurrogate:
    """Give the surrogate that a problem names, not fitted yet."""
    return resolve(problem.surrogate.ratio, SURFACES, "surrogate.ratio")(problem)


def propagated(problem: WingProblem) -> RatioSurrogate:
    """Quotient of a lift and a power Kriging."""
    return LiftToPower(lift_surrogate(problem, _kriging(problem)), _kriging(problem))


def direct(problem: WingProblem) -> RatioSurrogate:
    """One Kriging of the ratios."""
    return DirectRatio(_kriging(problem))


def _kriging(problem: WingProblem) -> Kriging:
    return Kriging(kernel=problem.surrogate.kernel, trend=problem.surrogate.trend)


SURFACES: Mapping[str, Callable[[WingProblem], RatioSurrogate]] = {"propagated": propagated, "direct": direct}
