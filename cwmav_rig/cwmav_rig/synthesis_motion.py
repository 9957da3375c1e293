# SPDX-License-Identifier: Apache-2.0
"""The true motion behind a synthetic recording, and the clocks of the instruments that see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.physics import aero, scatter
from cwmav_rig.synthesis_settings import Synthesis

Array = NDArray[np.float64]
FINE_RATE = 2000.0  # Hz, grid of the true motion
CLOCKS = ("force", "power", "camera", "tunnel")


@dataclass(frozen=True)
class Clock:
    """Clock of one instrument: it shows ``offset + (1 + skew) t`` at the true time t [s] since the start."""

    offset: float
    skew: float

    def shows(self, true_time: Array) -> Array:
        """Give the reading [s] at true times."""
        return self.offset + (1.0 + self.skew) * true_time

    def true(self, reading: Array) -> Array:
        """Give the true time [s] of readings."""
        return (reading - self.offset) / (1.0 + self.skew)


@dataclass(frozen=True)
class Motion:
    """The true controls over the run, on a uniform grid of true time [s]: Hz, rad (stroke and angle), m/s."""

    time: Array
    frequency: Array
    phase: Array
    angle: Array
    airspeed: Array

    def at(self, name: str, time: Array) -> Array:
        """One quantity at given true times."""
        return np.asarray(np.interp(time, self.time, getattr(self, name)))


def motion_of(settings: Synthesis, rng: np.random.Generator) -> Motion:
    """Draw frequency, angle and airspeed over the run and a second on either side."""
    spread = settings.scatter
    step = 1.0 / FINE_RATE
    margin = 1.0  # s of motion before and after, for instruments whose clocks are off
    n = int(np.ceil((settings.seconds + 2.0 * margin) * FINE_RATE)) + 1
    time = np.arange(n) * step - margin
    mean = settings.flapping_frequency
    frequency = scatter.frequency_process(
        n, step, mean, mean * spread.frequency_relative, spread.frequency_correlation, rng
    )
    if settings.run != "flapping":
        frequency = np.zeros(n)
    phase = scatter.phase_of(frequency, step)
    rocking = np.radians(spread.angle_rocking_deg) if settings.run == "flapping" else 0.0
    slow = slow_angle(settings)
    angle = np.radians(settings.angle_of_attack_deg) + rocking * np.sin(phase + 0.7)
    angle = angle + scatter.memory_process(n, step, spread.angle_memory, slow, rng)
    sigma = max(spread.airspeed_relative * settings.airspeed, spread.airspeed_least)
    wind = scatter.memory_process(n, step, spread.airspeed_memory, sigma, rng)
    airspeed = np.zeros(n) if settings.run == "wind_off" else settings.airspeed + wind
    return Motion(np.asarray(time, np.float64), frequency, phase, angle, airspeed)


def slow_angle(settings: Synthesis) -> float:
    """Give the deviation of the slow part [rad]: what rocking and camera noise leave of the total."""
    spread = settings.scatter
    rest = spread.angle_deg**2 - spread.angle_rocking_deg**2 / 2.0 - settings.artefacts.pixel_noise_deg**2
    return float(np.radians(np.sqrt(max(rest, 0.0))))


def clocks_of(settings: Synthesis, rng: np.random.Generator) -> dict[str, Clock]:
    """Draw offset and skew of every clock; that of the force sensor is the reference."""
    art = settings.artefacts
    clocks = {"force": Clock(0.0, 0.0)}
    for name in CLOCKS[1:]:
        offset, skew = rng.uniform(-1.0, 1.0, 2)
        clocks[name] = Clock(float(offset * art.clock_offset), float(skew * art.clock_skew))
    return clocks


def setting_of(settings: Synthesis) -> aero.Point:
    """Give the setting of the rig; the frequency is zero in a still run."""
    return aero.Point(
        settings.flapping_frequency if settings.run == "flapping" else 0.0,
        float(np.radians(settings.angle_of_attack_deg)),
        settings.airspeed,
    )
