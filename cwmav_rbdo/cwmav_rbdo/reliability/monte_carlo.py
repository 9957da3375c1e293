# SPDX-License-Identifier: Apache-2.0
"""Crude Monte Carlo: the reference that needs no assumption."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from cwmav_common.errors import InputError
from cwmav_rbdo.reliability.estimate import Band, Estimate
from cwmav_rbdo.reliability.inputs import GaussianNoise, Inputs, LimitState, standard_limit_state

Array = NDArray[np.float64]
BLOCK = 100_000


def _checked(samples: int) -> None:
    if samples < 2:
        raise InputError(f"samples = {samples}: allowed is an integer >= 2")


def _proportion(failures: int, samples: int, method: str) -> Estimate:
    p = failures / samples
    # Without a failure (or a success) the binomial error would be zero: the rule of succession stands in.
    spread = p if 0 < failures < samples else (failures + 1.0) / (samples + 2.0)
    return Estimate(p, math.sqrt(spread * (1.0 - spread) / samples), samples, method)


def monte_carlo(
    g: LimitState, inputs: Inputs, rng: np.random.Generator, samples: int = 1_000_000
) -> Estimate:
    """Share of random points at which the limit state has failed.

    Parameters
    ----------
    g : callable
        Physical points (n, d) -> (n,), failed where <= 0.
    inputs : Inputs
    rng : numpy.random.Generator
    samples : int
        Evaluated in blocks of 1e5, so memory stays bounded.

    Returns
    -------
    Estimate
        With the binomial standard error.
    """
    _checked(samples)
    evaluate = standard_limit_state(g, inputs)
    failures = 0
    for first in range(0, samples, BLOCK):
        U = rng.standard_normal((min(BLOCK, samples - first), inputs.dimension))
        failures += int(np.count_nonzero(evaluate(U) <= 0.0))
    return _proportion(failures, samples, "monte_carlo")


def monte_carlo_band(
    surrogate: Callable[[Array], tuple[Array, Array]],
    inputs: Inputs,
    rng: np.random.Generator,
    samples: int = 1_000_000,
    k: float = 1.96,
) -> Band:
    """Monte Carlo on a surrogate, with and without the surrogate's own uncertainty.

    Parameters
    ----------
    surrogate : callable
        Physical points (n, d) -> mean and standard deviation of the limit state, each (n,).
    k : float
        Half width of the band in standard deviations.
    """
    _checked(samples)
    failures = np.zeros(3, dtype=np.int64)
    total = total_squared = 0.0
    for first in range(0, samples, BLOCK):
        U = rng.standard_normal((min(BLOCK, samples - first), inputs.dimension))
        mean, std = surrogate(inputs.from_standard(U))
        for position, shift in enumerate((0.0, k, -k)):
            failures[position] += np.count_nonzero(mean + shift * std <= 0.0)
        chance = np.where(std > 0.0, ndtr(-mean / np.where(std > 0.0, std, 1.0)), mean <= 0.0)
        total += float(chance.sum())
        total_squared += float(chance @ chance)
    p = total / samples
    variance = max(total_squared / samples - p * p, 0.0) / samples
    surface, low, high = (_proportion(int(count), samples, "monte_carlo") for count in failures)
    return Band(surface, Estimate(p, math.sqrt(variance), samples, "monte_carlo"), low, high)


def monte_carlo_designs(
    g: LimitState,
    designs: ArrayLike,
    std: ArrayLike,
    rng: np.random.Generator,
    samples: int = 10_000,
) -> tuple[Array, Array]:
    """Probability of failure of many designs under the same scatter.

    All designs see the same random numbers, so that differences between them are not noise.

    Parameters
    ----------
    g : callable
    designs : (m, d) array
    std : (d,) array
        Standard deviation of each variable.

    Returns
    -------
    pf, pf_std : (m,) arrays
    """
    _checked(samples)
    centres = np.atleast_2d(np.asarray(designs, dtype=np.float64))
    noise = GaussianNoise(np.zeros(centres.shape[1]), std)
    U = rng.standard_normal((samples, centres.shape[1]))
    offsets = noise.from_standard(U)
    pf, pf_std = np.empty(len(centres)), np.empty(len(centres))
    for row, centre in enumerate(centres):
        failures = sum(
            int(np.count_nonzero(np.asarray(g(centre + offsets[i : i + BLOCK])) <= 0.0))
            for i in range(0, samples, BLOCK)
        )
        estimate = _proportion(failures, samples, "monte_carlo")
        pf[row], pf_std[row] = estimate.value, estimate.std
    return pf, pf_std
