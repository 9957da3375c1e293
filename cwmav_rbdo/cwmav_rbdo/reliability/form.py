# SPDX-License-Identifier: Apache-2.0
"""First-order reliability method: the point of failure nearest to the origin of the standard normal space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from cwmav_common.errors import WorkError
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.inputs import Inputs, LimitState, standard_limit_state

Array = NDArray[np.float64]

STEP = 1e-4
"""Of the central differences, in standard deviations."""
FARTHEST = 12.0
"""No design point is sought beyond; the probability there is below 2e-33."""


@dataclass(frozen=True)
class DesignPoint:
    """Most probable point of failure.

    Attributes
    ----------
    u : (d,) array
        In the standard normal space.
    beta : float
        Its distance from the origin, negative when the origin itself has failed.
    gradient : (d,) array
        Of the limit state there, per standard deviation.
    evaluations : int
    converged : bool
    """

    u: Array
    beta: float
    gradient: Array
    evaluations: int
    converged: bool


def _with_gradient(g: LimitState, u: Array) -> tuple[float, Array]:
    d = len(u)
    steps = STEP * np.eye(d)
    values = g(np.vstack([u, u + steps, u - steps]))
    return float(values[0]), (values[1 : d + 1] - values[d + 1 :]) / (2.0 * STEP)


def find_design_point(
    g: LimitState, start: Array, tolerance: float = 1e-4, iterations: int = 60
) -> DesignPoint:
    """Search with the improved Hasofer-Lind-Rackwitz-Fiessler iteration (Zhang and Der Kiureghian 1995).

    Parameters
    ----------
    g : callable
        Limit state in the standard normal space.
    start : (d,) array
    tolerance : float
        On the limit state relative to its value at the start and on the angle between the point and the
        gradient.

    Returns
    -------
    DesignPoint
        Its ``converged`` tells whether the tolerance was met; nothing is raised.
    """
    u = np.array(start, dtype=np.float64)
    value, gradient = _with_gradient(g, u)
    at_origin = value if not np.any(u) else float(g(np.zeros((1, len(u))))[0])
    evaluations = 2 * len(u) + 1 + bool(np.any(u))
    scale = abs(at_origin) or abs(value) or 1.0
    converged = False
    for _ in range(iterations):
        norm2 = float(gradient @ gradient)
        if norm2 == 0.0 or not math.isfinite(norm2):
            break
        target = gradient * (float(gradient @ u) - value) / norm2
        length = float(np.linalg.norm(target))
        if length > FARTHEST:
            target *= FARTHEST / length
        if abs(value) <= tolerance * scale and np.linalg.norm(target - u) <= tolerance * max(1.0, length):
            converged = True
            break
        u, value, tried = _line_search(g, u, value, target - u, norm2)
        value, gradient = _with_gradient(g, u)
        evaluations += tried + 2 * len(u) + 1
    beta = math.copysign(float(np.linalg.norm(u)), at_origin)
    return DesignPoint(u, beta, gradient, evaluations, converged)


def _line_search(
    g: LimitState, u: Array, value: float, direction: Array, norm2: float
) -> tuple[Array, float, int]:
    """Armijo search on the merit |u|^2 / 2 + c |g|; all step lengths are tried in one vectorised call."""
    penalty = (
        2.0 * max(float(np.linalg.norm(u)), float(np.linalg.norm(u + direction))) / math.sqrt(norm2) + 1e-12
    )
    steps = 0.5 ** np.arange(7)
    points = u + steps[:, None] * direction
    values = g(points)
    merits = 0.5 * np.einsum("ij,ij->i", points, points) + penalty * np.abs(values)
    here = 0.5 * float(u @ u) + penalty * abs(value)
    better = np.flatnonzero(merits < here - 1e-4 * steps * abs(here))
    chosen = int(better[0]) if len(better) else int(np.argmin(merits))
    return points[chosen], float(values[chosen]), len(steps)


def find_design_points(
    g: LimitState, dimension: int, rng: np.random.Generator, starts: int
) -> tuple[list[DesignPoint], int]:
    """Search from the origin and from random points of the sphere of radius 3; nearest first, each once.

    Returns
    -------
    points : list of DesignPoint
        Converged ones, distinct by more than a tenth of a standard deviation.
    evaluations : int
        Of all searches together.
    """
    directions = rng.standard_normal((starts - 1, dimension))
    directions *= 3.0 / np.linalg.norm(directions, axis=1, keepdims=True)
    found: list[DesignPoint] = []
    evaluations = 0
    for start in np.vstack([np.zeros((1, dimension)), directions]):
        point = find_design_point(g, start)
        evaluations += point.evaluations
        if point.converged and all(np.linalg.norm(point.u - other.u) > 0.1 for other in found):
            found.append(point)
    return sorted(found, key=lambda point: abs(point.beta)), evaluations


def form(g: LimitState, inputs: Inputs, rng: np.random.Generator | None = None, starts: int = 6) -> Estimate:
    """First-order probability of failure ``Phi(-beta)`` of the nearest design point found.

    Exact for a limit state linear in normal variables; its error is unknown otherwise, so `std` is nan.
    Several design points are not added up: see :func:`importance_sampling` for that.

    Parameters
    ----------
    rng : numpy.random.Generator, optional
        Of the random starts; a fixed seed by default.
    starts : int
        Searches: one from the origin, which a symmetric limit state can leave without a direction, the
        others from random points.

    Raises
    ------
    WorkError
        If no search converges.
    """
    evaluate = standard_limit_state(g, inputs)
    generator = np.random.default_rng(0) if rng is None else rng
    points, evaluations = find_design_points(evaluate, inputs.dimension, generator, starts)
    if not points:
        raise WorkError(f"FORM: none of {starts} searches for a design point converged")
    return Estimate(float(ndtr(-points[0].beta)), math.nan, evaluations, "form")
