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
from cwmav_rbdo.lift_to_power import LiftToPower, RatioSurrogate
from cwmav_rbdo.ratio_margin import LiftMargin, RatioMargin
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]
Surface = RatioSurrogate
Function = Callable[[Array], Array]

_ROOT_STEPS = 30  # of the search for a percentile at most; about eight are needed
_ROOT_SURE = 1e-6  # error of a reliability index that ends it
_NODES = 9  # Gauss-Hermite nodes across the lines of a percentile
_ANGLES = 48  # directions of a percentile where the lines disagree
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
    target = -float(ndtri(level))
    low, high = mean - _REACH * spread, mean + 3.0 * spread
    above, below = beta(low) - target, beta(high) - target
    for growth in range(_GROWTHS):
        short = above < 0.0
        if not np.any(short):
            break
        high, below = np.where(short, low, high), np.where(short, above, below)
        low = np.where(short, low - 2.0 ** (growth + 1) * _REACH * spread, low)
        above = np.where(short, beta(low) - target, above)
    return _falling_root(lambda t: beta(t) - target, low, high, above, below)


def _falling_root(f: Function, low: Array, high: Array, above: Array, below: Array) -> Array:
    """Roots of falling functions in brackets, by the Illinois variant of the false position; (n,).

    Where an end of the bracket is no bracket, the root is that end. Every third step halves the bracket.
    """
    t, was_above = 0.5 * (low + high), np.zeros(len(low), dtype=bool)
    for step in range(_ROOT_STEPS):
        slope = above - below
        share = np.where(slope > 0.0, above / np.where(slope > 0.0, slope, 1.0), 0.5)
        t = low + (0.5 if step % 3 == 2 else np.clip(share, 0.0, 1.0)) * (high - low)
        value = f(t)
        if np.all((np.abs(value) < _ROOT_SURE) | (high - low < 1e-9 * np.abs(t))):
            break
        is_above = value >= 0.0
        # An end that stays a second time has its value halved, or the bracket would close from one side only.
        stays = (is_above == was_above) & (step > 0)
        below = np.where(is_above, np.where(stays, 0.5 * below, below), value)
        above = np.where(is_above, value, np.where(stays, 0.5 * above, above))
        low, high, was_above = np.where(is_above, t, low), np.where(is_above, high, t), is_above
    return t


def _parts(surface: Surface) -> LiftToPower:
    if not isinstance(surface, LiftToPower):
        raise InputError("goal: least_power needs surrogates of lift and power: surrogate.ratio propagated")
    return surface
