# SPDX-License-Identifier: Apache-2.0
"""Airspeed from a pitot tube."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GAS_CONSTANT = 287.05  # J/(kg K), dry air
ZERO_CELSIUS = 273.15


def density(temperature_celsius: Array | float, pressure: Array | float) -> Array:
    """Density of dry air ``p / (R T)`` [kg/m3]."""
    return np.asarray(pressure / (GAS_CONSTANT * (np.asarray(temperature_celsius) + ZERO_CELSIUS)))


def from_pitot(difference: Array, temperature_celsius: Array | float, pressure: Array | float) -> Array:
    """Speed ``sqrt(2 dp / rho)`` [m/s] from the pitot difference [Pa]; both have the same sign."""
    ratio = 2.0 * np.asarray(difference) / density(temperature_celsius, pressure)
    return np.asarray(np.sign(ratio) * np.sqrt(np.abs(ratio)))
