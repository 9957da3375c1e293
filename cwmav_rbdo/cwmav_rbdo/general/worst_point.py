# SPDX-License-Identifier: Apache-2.0
"""Inverse first-order reliability: the worst point of a limit state at a given distance from the mean.

The performance-measure approach writes ``P(g > 0) >= Phi(beta)`` as ``min g(u) >= 0`` over the sphere
``|u| = beta`` in the standard normal space (Tu, Choi and Park 1999, J. Mech. Design 121:557). Plain iteration
of ``u = -beta grad g / |grad g|`` oscillates on concave functions; here every step is damped until g falls,
from several starts at once.
"""

from __future__ import annotations

from collections.abc import Callable

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
    for _ in range(iterations):
        slope = _gradient(g, u)
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        target = np.where(size > 0.0, -beta * slope / np.where(size > 0.0, size, 1.0), u)
        if np.all((step < 1e-3) | (np.linalg.norm(target - u, axis=1) < 1e-4 * beta)):
            break
        tried = _on_sphere(u + step[:, None] * (target - u), beta)
        tried_value = g(tried)
        better = tried_value < value
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


def _on_sphere(u: Array, beta: float) -> Array:
    size = np.linalg.norm(u, axis=1, keepdims=True)
    return beta * np.where(size > 0.0, u / np.where(size > 0.0, size, 1.0), np.eye(u.shape[1])[0])


def _gradient(g: Function, u: Array) -> Array:
    n, m = u.shape
    steps = _STEP * np.vstack([np.eye(m), -np.eye(m)])
    values = g((u[:, None, :] + steps).reshape(n * 2 * m, m)).reshape(n, 2, m)
    return (values[:, 0] - values[:, 1]) / (2.0 * _STEP)
