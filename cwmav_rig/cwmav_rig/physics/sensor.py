# SPDX-License-Identifier: Apache-2.0
"""What the force chain adds to the force: mounting resonance, mains, drift, noise, resolution, range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, lfilter_zi

Array = NDArray[np.float64]

WARM_UP_TIME = 300.0  # s
MOTOR_HEATING, HEATING_TIME = 10.0, 120.0  # K, s


def resonance(force: Array, rate: float, frequency: float, damping: float) -> Array:
    """Pass force (n,) through a mount of one degree of freedom, static gain one (exact zero-order hold)."""
    w = 2.0 * np.pi * frequency
    wd = w * np.sqrt(1.0 - damping**2)
    step = 1.0 / rate
    decay = np.exp(-damping * w * step)
    cosine, sine = np.cos(wd * step), np.sin(wd * step)
    ratio = damping * w / wd
    b1 = 1.0 - decay * (cosine + ratio * sine)
    b2 = decay**2 + decay * (ratio * sine - cosine)
    b, a = np.array([0.0, b1, b2]), np.array([1.0, -2.0 * decay * cosine, decay**2])
    result, _ = lfilter(b, a, force, zi=lfilter_zi(b, a) * force[0])
    return np.asarray(result)


def mains(time: Array, amplitude: float, frequency: float, phase: float) -> Array:
    """Pick-up of the mains and its third harmonic (a third of it) [N]."""
    turn = 2.0 * np.pi * frequency * time + phase
    return amplitude * (np.sin(turn) + np.sin(3.0 * turn) / 3.0)


def bias(time: Array, walk: float, warm_up: float, thermal: float, rng: np.random.Generator) -> Array:
    """Zero drift at `time` (n,) [s]: random walk [N/sqrt(s)], warm-up [N] and motor heating [N/K]."""
    steps = np.diff(time, prepend=time[0])
    wander = np.cumsum(rng.standard_normal(len(time)) * np.sqrt(np.abs(steps))) * walk
    warming = warm_up * np.exp(-np.maximum(time, 0.0) / WARM_UP_TIME)
    heating = thermal * MOTOR_HEATING * (1.0 - np.exp(-np.maximum(time, 0.0) / HEATING_TIME))
    return np.asarray(wander + warming + heating)


def digitise(values: Array, least_count: float, full_scale: float) -> tuple[Array, NDArray[np.bool_]]:
    """Round to the least count and clip at the range; also say which samples were clipped."""
    clipped = np.abs(values) >= full_scale
    limited = np.clip(values, -full_scale, full_scale)
    if least_count > 0.0:
        limited = np.round(limited / least_count) * least_count
    return limited, clipped
