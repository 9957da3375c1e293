# SPDX-License-Identifier: Apache-2.0
"""Importance sampling: random points where failure is, weighted back to the true density."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from cwmav_common.errors import InputError
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.form import find_design_points
from cwmav_rbdo.reliability.inputs import Inputs, LimitState, standard_limit_state

Array = NDArray[np.float64]

DEFENSIVE = 0.1
"""Share of points drawn from the true density, so that no weight exceeds its inverse."""


def importance_sampling(
    g: LimitState,
    inputs: Inputs,
    rng: np.random.Generator,
    samples: int = 10_000,
    starts: int = 20,
) -> Estimate:
    """Sample a mixture of unit normal densities around all design points found, plus the true density.

    Parameters
    ----------
    g : callable
    inputs : Inputs
    rng : numpy.random.Generator
    samples : int
        Points beside those of the searches.
    starts : int
        Searches for design points. A failure region that none of them finds is seen by the defensive part
        alone, which the standard error then shows.

    Returns
    -------
    Estimate
    """
    if samples < 10 or starts < 1:
        raise InputError(f"samples = {samples}, starts = {starts}: allowed are samples >= 10 and starts >= 1")
    evaluate = standard_limit_state(g, inputs)
    d = inputs.dimension
    points, spent = find_design_points(evaluate, d, rng, starts)
    centres = np.array([point.u for point in points if point.beta > 0.0]).reshape(-1, d)
    # Beyond two standard deviations behind the nearest, a design point adds nothing worth sampling.
    if len(centres):
        distance = np.linalg.norm(centres, axis=1)
        centres = centres[distance <= distance.min() + 2.0]
    shares = np.array([ndtr(-np.linalg.norm(c)) for c in centres])
    # An even split is mixed in, because a region of several design points counts more than its Phi(-beta).
    shares = 0.5 * shares / shares.sum() + 0.5 / len(shares) if len(shares) else shares
    shares = np.append((1.0 - DEFENSIVE) * shares, DEFENSIVE if len(shares) else 1.0)
    centres = np.vstack([centres, np.zeros((1, d))])
    chosen = rng.choice(len(centres), size=samples, p=shares)
    U = centres[chosen] + rng.standard_normal((samples, d))
    failed = evaluate(U) <= 0.0
    # Density ratio of each component to the standard normal: exp(c.u - |c|^2 / 2).
    exponents = U[failed] @ centres.T - 0.5 * np.einsum("ij,ij->i", centres, centres)
    weights = np.zeros(samples)
    weights[failed] = 1.0 / (np.exp(exponents) @ shares)
    value = float(weights.mean())
    return Estimate(
        value, float(weights.std(ddof=1)) / math.sqrt(samples), spent + samples, "importance_sampling"
    )
