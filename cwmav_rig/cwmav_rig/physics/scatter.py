# SPDX-License-Identifier: Apache-2.0
"""How the controls wander: stationary Gaussian processes with exponential memory, and the stroke phase."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def memory_process(n: int, step: float, memory: float, sigma: float, rng: np.random.Generator) -> Array:
    """Ornstein-Uhlenbeck process (n,) at uniform steps of deviation `sigma` and correlation time `memory`.

    Exact in distribution at any step: AR(1) with coefficient ``exp(-step / memory)``, started stationary.
    """
    if sigma == 0.0:
        return np.zeros(n)
    coefficient = np.exp(-step / memory)
    noise = rng.standard_normal(n) * sigma * np.sqrt(1.0 - coefficient**2)
    noise[0] = sigma * rng.standard_normal()
    values: Array = lfilter([1.0], [1.0, -coefficient], noise)
    return values


def averaging_ratio(window: float, memory: float) -> float:
    """Variance of a window mean of such a process over its variance.

    ``2 (a - 1 + exp(-a)) / a^2`` with a = window / memory.
    """
    a = window / memory
    return float(2.0 * (a - 1.0 + np.exp(-a)) / a**2)


def frequency_process(
    n: int, step: float, mean: float, sigma: float, correlation: float, rng: np.random.Generator
) -> Array:
    """Instantaneous flapping frequency, (n,) [Hz], whose cycle averages have the standard deviation `sigma`.

    Parameters
    ----------
    correlation
        Of the instantaneous frequency over one mean period. The process is stationary, so the cycle averages
        scatter alike wherever a cycle is said to begin.
    """
    memory = -1.0 / (mean * np.log(correlation))
    instantaneous = sigma / np.sqrt(averaging_ratio(1.0 / mean, memory))
    values = mean + memory_process(n, step, memory, instantaneous, rng)
    return np.maximum(values, 0.1 * mean)


def phase_of(frequency: Array, step: float) -> Array:
    """Stroke phase [rad] at the same instants: integral of the frequency from the first sample."""
    turns = np.concatenate(([0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1])))) * step
    return 2.0 * np.pi * turns
