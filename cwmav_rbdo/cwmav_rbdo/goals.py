# SPDX-License-Identifier: Apache-2.0
"""What a wing study looks for: best ratio, best ratio that is held, or least power that carries the weight.

The paper maximises L/P under a reliability constraint on L/P itself (Eqs. 6 and 14). At a smooth maximum that
constraint does nothing: where the gradient vanishes, scatter changes little. Two other forms do not go idle:
the ratio that is held with the required reliability, maximised as such, and least power under a
constraint on the lift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cwmav_common.errors import InputError
from cwmav_rbdo.control_scatter import ControlScatter
from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower
from cwmav_rbdo.ratio_margin import LiftMargin, RatioMargin
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]
Surface = LiftToPower | DirectRatio
Function = Callable[[Array], Array]

_ROOT_STEPS = 18  # of the search for a percentile; each halves the interval or better
_NODES = 7  # Gauss-Hermite nodes across the lines of a percentile
_ANGLES = 24  # directions of a percentile where the lines disagree
_REACH = 4.0  # standard deviations to first order within which a percentile is sought at first
_GROWTHS = 12  # doublings of that


class Goal(Protocol):
    """Objective and requirement of a study on its surrogates; values are maximised."""

    @property
    def name(self) -> str:
        """Of the objective."""
        ...

    @property
    def unit(self) -> str:
        """Of the objective."""
        ...

    @property
    def sign(self) -> float:
        """Of the objective as a person reads it: -1 where the maximised value is its negative."""
        ...

    @property
    def requirement(self) -> str:
        """In words."""
        ...

    @property
    def constrained(self) -> bool:
        """Whether the requirement limits the design."""
        ...

    def quick(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Value of designs (n, d), cheap enough for a swarm."""
        ...

    def value(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Value of designs (n, d), exact on the surrogate."""
        ...

    def predict(self, surface: Surface, X: Array) -> tuple[Array, Array]:
        """Mean and standard deviation of what is maximised, without scatter; for expected improvement."""
        ...

    def margin(self, surface: Surface, value: float, shift: float = 0.0) -> RatioMargin | LiftMargin:
        """Limit state of the requirement; `value` is that of the design, for goals that require it."""
        ...


@dataclass(frozen=True)
class BestRatio:
    """The paper's: largest L/P whose L/P reaches `required` reliably."""

    required: float
    name: str = "L/P"
    unit: str = "N/W"
    sign: float = 1.0
    constrained: bool = True

    @property
    def requirement(self) -> str:
        """In words."""
        return f"L/P >= {self.required:g} N/W"

    def quick(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Mean of L/P."""
        return surface.mean

    def value(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Mean of L/P."""
        return surface.mean

    def predict(self, surface: Surface, X: Array) -> tuple[Array, Array]:
        """L/P and its error."""
        return surface.predict(X)

    def margin(self, surface: Surface, value: float, shift: float = 0.0) -> RatioMargin:
        """L/P minus the required one."""
        return RatioMargin(surface, self.required, shift)


@dataclass(frozen=True)
class BestPercentile:
    """Largest ratio that is held with the required reliability: always active, no limit to choose."""

    reliability: float
    name: str = "L/P held"
    unit: str = "N/W"
    sign: float = 1.0
    constrained: bool = False

    @property
    def requirement(self) -> str:
        """In words."""
        return f"L/P held with reliability {self.reliability:g}"

    def quick(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Percentile to first order: mean minus a multiple of the propagated scatter."""
        z = float(ndtri(self.reliability))
        return lambda X: surface.mean(X) - z * scatter.spread(surface.gradient(X), X)

    def value(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Percentile by root search on the exact probability."""
        return lambda X: percentile(surface, X, scatter, 1.0 - self.reliability)

    def predict(self, surface: Surface, X: Array) -> tuple[Array, Array]:
        """L/P and its error."""
        return surface.predict(X)

    def margin(self, surface: Surface, value: float, shift: float = 0.0) -> RatioMargin:
        """L/P minus the percentile of the design."""
        return RatioMargin(surface, value, shift)


@dataclass(frozen=True)
class LeastPower:
    """Least electrical power whose lift reaches `required` reliably: the weight, in level flight."""

    required: float
    name: str = "power"
    unit: str = "W"
    sign: float = -1.0
    constrained: bool = True

    @property
    def requirement(self) -> str:
        """In words."""
        return f"lift >= {self.required:g} N"

    def quick(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Negative power."""
        return lambda X: -_parts(surface).power_.predict(X)

    def value(self, surface: Surface, scatter: ControlScatter) -> Function:
        """Negative power."""
        return self.quick(surface, scatter)

    def predict(self, surface: Surface, X: Array) -> tuple[Array, Array]:
        """Negative power and its error."""
        mean, std = _parts(surface).power_.predict(X, return_std=True)
        return -np.asarray(mean), np.asarray(std)

    def margin(self, surface: Surface, value: float, shift: float = 0.0) -> LiftMargin:
        """Lift minus the required one."""
        return LiftMargin(_parts(surface), self.required, shift)


def goal_of(problem: WingProblem) -> Goal:
    """Give the goal that a problem names."""
    require = problem.require
    if problem.goal == "percentile":
        return BestPercentile(require.reliability)
    if problem.goal == "least_power":
        return LeastPower(float(require.lift or 0.0))
    return BestRatio(float(require.lift_to_power or 0.0))


def percentile(surface: Surface, X: Array, scatter: ControlScatter, level: float) -> Array:
    """Ratio below which the scattering design falls with probability `level`; (n,) [N/W].

    Parameters
    ----------
    surface : fitted surrogate
    X : (n, d) designs
    scatter : of the design variables
    level : probability, below one half
    """
    X = np.atleast_2d(X)

    def short_of(P: Array) -> Array:
        return surface.mean(P[:, :-1]) - P[:, -1]

    def beta(t: Array) -> Array:
        """Reliability index of staying above t; falls with t."""
        pf, _ = scatter.failure(short_of, X, _NODES, _ANGLES, t[:, None])
        return np.asarray(np.clip(-ndtri(pf), -9.0, 9.0))

    mean = surface.mean(X)
    first = scatter.spread(surface.gradient(X), X)
    # At a flat top the first order is nothing; the interval then grows until it holds the percentile.
    spread = np.maximum(first, 1e-3 * np.maximum(np.abs(mean), 1e-9))
    low, high = mean - _REACH * spread, mean + 3.0 * spread
    target = -float(ndtri(level))
    for growth in range(_GROWTHS):
        short = beta(low) < target
        if not np.any(short):
            break
        high = np.where(short, low, high)
        low = np.where(short, low - 2.0 ** (growth + 1) * _REACH * spread, low)
    for _ in range(_ROOT_STEPS):
        middle = 0.5 * (low + high)
        holds = beta(middle) >= target
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return np.asarray(0.5 * (low + high))


def _parts(surface: Surface) -> LiftToPower:
    if not isinstance(surface, LiftToPower):
        raise InputError("goal: least_power needs surrogates of lift and power: surrogate.ratio propagated")
    return surface
