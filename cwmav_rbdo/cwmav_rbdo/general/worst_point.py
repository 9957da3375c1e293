# SPDX-License-Identifier: Apache-2.0
"""Inverse first-order reliability: the worst point of a limit state at a given distance from the mean.

The performance-measure approach writes ``P(g > 0) >= Phi(beta)`` as ``min g(u) >= 0`` over the sphere
``|u| = beta`` in the standard normal space (Tu, Choi and Park 1999, J. Mech. Design 121:557). Plain iteration
of ``u = -beta grad g / |grad g|`` oscillates on concave functions; here every step is damped until g falls,
from several starts at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = Callable[[Array], Array]
_STEP = 1e-3


def worst_point(g: Function, beta: float, starts: Array, iterations: int = 30) -> tuple[Array, float]:
    """Minimise `g` over the sphere of radius `beta`.

    Parameters
    ----------
    g : callable
        Standard normal points (n, m) -> (n,), smooth and cheap.
    beta : float
        Radius, >= 0.
    starts : (s, m) array
        Points to begin at; only their directions matter.

    Returns
    -------
    u : (m,) array
    value : float
        g there.
    """
    m = starts.shape[1]
    if beta <= 0.0:
        origin = np.zeros(m)
        return origin, float(g(origin[None])[0])
    u = _on_sphere(starts, beta)
    value = g(u)
    step = np.ones(len(u))
    target, moved = u, True
    for _ in range(iterations):
        if moved:  # else every slope is where it was
            target = _steepest_on_sphere(g, u, beta)
        way = target - u
        if ((step < 1e-3) | (_length(way)[:, 0] < 1e-4 * beta)).all():
            break
        tried = _on_sphere(u + step[:, None] * way, beta)
        tried_value = g(tried)
        better = tried_value < value
        moved = bool(better.any())
        u = np.where(better[:, None], tried, u)
        value = np.where(better, tried_value, value)
        step = np.where(better, np.minimum(1.0, 2.0 * step), 0.4 * step)
    best = int(np.argmin(value))
    return u[best], float(value[best])


def steepest(g: Function, m: int) -> Array:
    """Direction in which `g` falls fastest at the origin, (1, m); the first axis where it is flat."""
    slope = _gradient(g, np.zeros((1, m)))
    return -slope if np.any(slope) else np.eye(m)[:1]


def slope_at(g: Function, u: Array) -> float:
    """Length of the gradient of `g` at one point (m,)."""
    return float(np.linalg.norm(_gradient(g, u[None])))


def _length(u: Array) -> Array:
    """Length of every row (n, m); (n, 1)."""
    return np.asarray(np.sqrt(np.add.reduce(u * u, axis=1, keepdims=True)))


def _on_sphere(u: Array, beta: float) -> Array:
    size = _length(u)
    if (size > 0.0).all():
        return beta * (u / size)
    return beta * np.where(size > 0.0, u / np.where(size > 0.0, size, 1.0), np.eye(u.shape[1])[0])


def _steepest_on_sphere(g: Function, u: Array, beta: float) -> Array:
    """Point of the sphere in the direction in which `g` falls fastest at `u`; `u` itself where it is flat."""
    slope = _gradient(g, u)
    size = _length(slope)
    if (size > 0.0).all():
        return np.asarray(-beta * slope / size)
    return np.where(size > 0.0, -beta * slope / np.where(size > 0.0, size, 1.0), u)


@cache
def _steps(m: int) -> Array:
    """Give the steps up and down every axis, (2 m, m)."""
    steps = _STEP * np.vstack([np.eye(m), -np.eye(m)])
    steps.setflags(write=False)
    return steps


def _gradient(g: Function, u: Array) -> Array:
    n, m = u.shape
    values = g((u[:, None, :] + _steps(m)).reshape(n * 2 * m, m)).reshape(n, 2, m)
    return (values[:, 0] - values[:, 1]) / (2.0 * _STEP)
