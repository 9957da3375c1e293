# SPDX-License-Identifier: Apache-2.0
"""Electrical power of crank, gear and motor.

``physical`` (default): mean aerodynamic, inertial and friction power of four panels through gear and motor
on a bench supply held at a constant voltage. ``paper_law``: the smallest law that has the optima of the
paper's Tables 5 and 6; no flapping drive behaves like it, and every output that uses it says so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rig.physics.aero import SWEEP, Point, mean_lift

Array = NDArray[np.float64]

POWER_MODELS = ("physical", "paper_law")
DAMPING = 9.8e-6  # N m s2 per panel: 0.5 rho Cn integral of c r^3 dr
INERTIAL_AT_16_HZ = 0.15  # W, positive inertial power; grows with the cube of the frequency
NOT_RECOVERED = 0.30  # share of it that the wings do not give back to the crank
FRICTION = 6.3e-3  # W/Hz, hinges
GEAR, GEAR_EFFICIENCY = 21.3, 0.80
TORQUE_CONSTANT = 1.475e-3  # N m/A
IDLE_CURRENT = 0.10  # A
SUPPLY_VOLTAGE = 4.0  # V
ELECTRONICS = 0.20  # W


def mechanical_power(frequency: float) -> float:
    """Cycle mean of the power at the crank [W]; mean of sin^3 over a half cycle is 0.424."""
    aerodynamic = 4.0 * DAMPING * 0.424 * (2.0 * np.pi * frequency * SWEEP / 2.0) ** 3
    inertial = NOT_RECOVERED * INERTIAL_AT_16_HZ * (frequency / 16.0) ** 3
    return float(aerodynamic + inertial + FRICTION * frequency)


def physical_power(frequency: float) -> float:
    """Mean electrical power [W]: ``0.20 + V (I0 + T / (eta G k))`` with the mean crank torque T."""
    torque = mechanical_power(frequency) / (2.0 * np.pi * frequency)
    current = IDLE_CURRENT + torque / (GEAR_EFFICIENCY * GEAR * TORQUE_CONSTANT)
    return ELECTRONICS + SUPPLY_VOLTAGE * current


def paper_power(point: Point, lift: float) -> float:
    """Mean electrical power of the empirical law ``0.35 + 0.202 |L| F + 0.0435 U^2 sin^2(AoA) F`` [W]."""
    wind = point.airspeed * np.sin(point.angle_of_attack)
    return float(0.35 + 0.202 * abs(lift) * point.frequency + 0.0435 * wind**2 * point.frequency)


def electrical_power(model: str, point: Point) -> float:
    """Mean electrical power [W] at `point` by the named model."""
    if model == "physical":
        return physical_power(point.frequency)
    if model == "paper_law":
        return paper_power(point, mean_lift(point))
    raise InputError(f"power_model {model!r}; allowed: {', '.join(POWER_MODELS)}")


def current_shape(phase: Array, ripple: float) -> Array:
    """Power over the cycle relative to its mean: two peaks per cycle, mean 1, largest deviation `ripple`."""
    shape = np.cos(2.0 * phase - 0.6) + 0.25 * np.cos(4.0 * phase)
    return 1.0 - ripple * shape / 1.25


def supply(power: Array, source_resistance: float) -> tuple[Array, Array]:
    """Voltage [V] and current [A] behind a source resistance [Ohm] whose product is `power`.

    The open-circuit voltage is such that the mean load sees the supply voltage: v = v0 - r i and v i = power.
    Leads for a large current are thick: they never take more than a tenth of the supply voltage.
    """
    mean_current = power.mean() / SUPPLY_VOLTAGE
    source_resistance = min(source_resistance, 0.1 * SUPPLY_VOLTAGE / mean_current)
    open_circuit = SUPPLY_VOLTAGE + source_resistance * mean_current
    if source_resistance == 0.0:
        return np.full_like(power, SUPPLY_VOLTAGE), power / SUPPLY_VOLTAGE
    voltage = 0.5 * (open_circuit + np.sqrt(open_circuit**2 - 4.0 * source_resistance * power))
    return voltage, power / voltage
