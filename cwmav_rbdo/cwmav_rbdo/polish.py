# SPDX-License-Identifier: Apache-2.0
"""Gradient polish of an optimum found by a swarm: sequential quadratic programming in a box (SLSQP)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from cwmav_common.errors import InputError
from cwmav_rbdo.space import checked_bounds

Array = NDArray[np.float64]
Function = Callable[[Array], Array]
"""Vectorised function: points (n, d) -> (n,)."""

STEP = 1e-4
"""Of the central differences, in units of the range of each variable."""


@dataclass(frozen=True)
class Polished:
    """Outcome of a polish.

    Attributes
    ----------
    x : (d,) array
        The start itself where nothing better was found.
    f : float
    violation : float
        Largest amount by which a constraint is missed, 0 when all hold.
    evaluations : int
        Points at which the objective was evaluated.
    """

    x: Array
    f: float
    violation: float
    evaluations: int


def polish(
    f: Function,
    lo: ArrayLike,
    hi: ArrayLike,
    start: ArrayLike,
    constraints: Sequence[Function] = (),
    *,
    tolerance: float = 1e-6,
    iterations: int = 50,
) -> Polished:
    """Improve a point by SLSQP with vectorised central differences.

    Parameters
    ----------
    f : callable
        Minimised; smooth near the start.
    lo, hi : (d,) arrays
        Bounds; no point outside is returned, and differences next to a bound are taken inwards.
    start : (d,) array
        Inside the bounds.
    constraints : sequence of callables
        Each is to be >= 0; of order one where it is far from binding.
    tolerance : float
        A constraint may be missed by this much.

    Returns
    -------
    Polished
        Never worse than the start: smaller violation first, then smaller objective.

    Raises
    ------
    InputError
        On wrong bounds or a start outside them.
    """
    lower, upper = checked_bounds(lo, hi)
    x0 = np.asarray(start, dtype=np.float64)
    if x0.shape != lower.shape or np.any(x0 < lower) or np.any(x0 > upper):
        raise InputError(f"start: {x0} is not inside [{lower}, {upper}]")
    width = upper - lower
    counted = _Counted(f)
    scale = abs(counted.at(x0)) or 1.0

    def to_x(z: Array) -> Array:
        return np.clip(lower + width * z, lower, upper)

    def sloped(function: Function, divisor: float) -> Callable[[Array], Array]:
        return lambda z: _difference(function, to_x(z), lower, upper) * width / divisor

    conditions: list[Any] = [
        {"type": "ineq", "fun": lambda z, c=c: float(c(to_x(z)[None])[0]), "jac": sloped(c, 1.0)}
        for c in constraints
    ]
    found: Any = minimize(  # type: ignore[call-overload]
        lambda z: counted.at(to_x(z)) / scale,
        (x0 - lower) / width,
        jac=sloped(counted, scale),
        bounds=[(0.0, 1.0)] * len(lower),
        constraints=conditions,
        method="SLSQP",
        options={"maxiter": iterations, "ftol": 1e-10},
    )
    candidates = [(x, *_judged(counted, constraints, x, tolerance)) for x in (x0, to_x(found.x))]
    x, value, violation = min(candidates, key=lambda c: (c[2], c[1]))
    return Polished(x, value, violation, counted.evaluations)


class _Counted:
    def __init__(self, function: Function) -> None:
        self.function = function
        self.evaluations = 0

    def __call__(self, X: Array) -> Array:
        self.evaluations += len(X)
        return self.function(X)

    def at(self, x: Array) -> float:
        return float(self(x[None])[0])


def _judged(f: _Counted, constraints: Sequence[Function], x: Array, tolerance: float) -> tuple[float, float]:
    missed = max((-float(c(x[None])[0]) for c in constraints), default=0.0)
    value = f.at(x)
    if not np.isfinite(value):
        return value, np.inf
    return value, missed if missed > tolerance else 0.0


def _difference(function: Function, x: Array, lower: Array, upper: Array) -> Array:
    """Gradient by differences that stay in the box, in one vectorised call."""
    steps = STEP * (upper - lower)
    up = np.minimum(x + steps, upper)
    down = np.maximum(x - steps, lower)
    points = np.vstack([np.where(np.eye(len(x)) > 0, up, x), np.where(np.eye(len(x)) > 0, down, x)])
    values = function(points)
    return np.asarray((values[: len(x)] - values[len(x) :]) / (up - down))
