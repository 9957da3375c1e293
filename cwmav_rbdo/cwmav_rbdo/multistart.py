# SPDX-License-Identifier: Apache-2.0
"""Maximum of a likelihood with several hills: climbs from the best of a screened Latin hypercube."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from cwmav_rbdo.likelihood import Hyperparameters, Likelihood

Array = NDArray[np.float64]
End = tuple[float, Array]

ITERATIONS = 100
_FIRST = 8
"""Iterations of a further start before it is decided whether it goes on."""
_RIVAL = 10.0
"""Log-likelihood by which a start may be behind then and still overtake."""
_TOGETHER = 0.1
"""Logarithms of hyperparameters closer than this are on the same hill."""
_TRIES = 4
"""Evaluations along one direction that are enough where the correlation matrix is all but singular."""
_SINGULAR = 1e-11
"""Least pivot of the factorisation below which rounding makes up some 0.01 of the log-likelihood."""
_APART = 0.7
"""Least distance of two starts in the logarithm of some hyperparameter: a factor of two."""


def well_apart(points: Array, values: Array, count: int) -> Array:
    """Best points that lie apart from each other; (at most count, number of hyperparameters).

    Neighbours of a better point would climb the same hill, so they give way to points elsewhere: a rough
    response has its hill at short length scales, and the long ones, where it passes for noise, another.
    """
    chosen: list[Array] = []
    for point in points[np.argsort(values, kind="stable")]:
        if all(np.max(np.abs(point - other)) > _APART for other in chosen):
            chosen.append(point)
        if len(chosen) == count:
            break
    return np.array(chosen)


def maximise(likelihood: Likelihood, starts: Array) -> Hyperparameters:
    """Climb from every start with L-BFGS-B and return the best end.

    The first goes to the top. The others give up where they come upon the hill of a former one, or are far
    behind after a few iterations.

    Parameters
    ----------
    likelihood : Likelihood
    starts : (k, number of hyperparameters) array
        The most promising first.
    """
    ends: list[End] = []
    for start in starts:
        ends.append(_climb(likelihood, start, ends))
    best_value, best_point = min(ends, key=lambda end: end[0])
    length, variance, nugget = likelihood.unpack(best_point)
    return Hyperparameters(
        best_point,
        length,
        variance if likelihood.noisy else None,
        nugget,
        -best_value * len(likelihood.f),
    )


def _climb(
    likelihood: Likelihood, start: Array, before: Sequence[tuple[float, Array]]
) -> tuple[float, Array]:
    leader, n = min((value for value, _ in before), default=np.inf), len(likelihood.f)
    best, iteration, tries = (np.inf, start), 0, 0

    def objective(p: Array) -> tuple[float, Array]:
        nonlocal best, tries
        value, gradient, pivot = likelihood.evaluate(p)
        tries += 1
        if tries > _TRIES and pivot < _SINGULAR:
            raise _FlatError
        if value < best[0]:
            best = value, p.copy()
        return value, gradient

    def watch(intermediate_result: Any) -> None:
        nonlocal iteration, tries
        iteration, tries = iteration + 1, 0
        x, behind = intermediate_result.x, (intermediate_result.fun - leader) * n
        if any(np.max(np.abs(x - top)) < _TOGETHER for _, top in before) or (
            iteration == _FIRST and behind > _RIVAL
        ):
            raise StopIteration

    with suppress(_FlatError):
        minimize(
            objective,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=likelihood.bounds,
            callback=watch,
            options={"maxiter": ITERATIONS, "ftol": 1e-6, "gtol": 1e-5},
        )
    return best


class _FlatError(Exception):
    """A line search that rounding leads astray."""
