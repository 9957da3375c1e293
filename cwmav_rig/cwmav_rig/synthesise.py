# SPDX-License-Identifier: Apache-2.0
"""Synthetic rig recordings from a physical model, always marked as such, with their truth beside the data.

The true motion (frequency, angle, airspeed) is drawn on a fine time grid, the air loads and the power
follow from it, then each instrument sees them through its own clock, noise and faults (see ``physics``).
The random streams of the parts are spawned from one seed, so that switching one artefact off leaves the
rest unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.physics import aero, drive
from cwmav_rig.synthesis_force import air_loads, force_of
from cwmav_rig.synthesis_motion import Clock, Motion, clocks_of, motion_of, setting_of, slow_angle
from cwmav_rig.synthesis_settings import Synthesis

Array = NDArray[np.float64]
ROLLING = 0.37  # Hz, beat of the camera's read-out with its clock


@dataclass(frozen=True)
class Truth:
    """What a synthetic recording is known to hold: nominal scatter, realised means, clocks."""

    synthetic: bool
    seed: int
    power_model: str
    flapping_frequency_hz: dict[str, float]
    angle_of_attack_deg: dict[str, float]
    forward_velocity_m_s: dict[str, float]
    lift_n: float
    drag_n: float
    power_w: float
    cycles: int
    clock_offsets_s: dict[str, float]
    clock_skews: dict[str, float]
    force_gain: float


@dataclass(frozen=True)
class Signals:
    """What the instruments recorded: stamps [s] in each instrument's own clock from the start of the run."""

    force: Array  # (n, 6)
    overload: NDArray[np.bool_]  # (n,)
    tares: tuple[tuple[float, Array], ...]  # start [s], (m, 6)
    voltage: Array
    current: Array
    angle_stamps: Array
    angle: Array
    wind_stamps: Array
    wind: Array
    clocks: dict[str, Clock]
    truth: Truth


def generate(settings: Synthesis) -> Signals:
    """Draw the motion and let every instrument see it."""
    streams = np.random.SeedSequence(settings.seed).spawn(8)
    rngs = [np.random.Generator(np.random.PCG64(s)) for s in streams]
    motion = motion_of(settings, rngs[0])
    clocks = clocks_of(settings, rngs[1])
    force, overload, tares, gain = force_of(settings, motion, rngs[2])
    voltage, current, power = _power(settings, motion, clocks["power"], rngs[3])
    angle_stamps, angle = _camera(settings, motion, clocks["camera"], rngs[4])
    wind_stamps, wind = _tunnel(settings, motion, clocks["tunnel"])
    truth = _truth(settings, motion, clocks, power, gain)
    return Signals(
        force, overload, tares, voltage, current, angle_stamps, angle, wind_stamps, wind, clocks, truth
    )


def synthesise(path: str | Path, settings: Synthesis | None = None) -> Truth:
    """Write a synthetic recording: an ``.mcap`` file, or a rosbag2 folder when `path` has no suffix.

    Returns
    -------
    Truth
        Also stored in the recording: as metadata ``cwmav`` and on the topic ``/rig/truth``.

    Raises
    ------
    InputError
        The place cannot be written to.
    """
    from cwmav_rig.synthesis_write import write_recording

    settings = settings or Synthesis()
    signals = generate(settings)
    write_recording(Path(path), settings, signals)
    return signals.truth


def truth_mapping(truth: Truth) -> dict[str, Any]:
    """Give the truth as plain nested values."""
    return {name: getattr(truth, name) for name in truth.__dataclass_fields__}


def _power(
    settings: Synthesis, motion: Motion, clock: Clock, rng: np.random.Generator
) -> tuple[Array, Array, float]:
    art, ins = settings.artefacts, settings.instruments
    n = round(settings.seconds * ins.power_rate)
    time = clock.true(np.arange(n) / ins.power_rate)
    point = setting_of(settings)
    mean, slopes = drive.ELECTRONICS, (0.0, 0.0, 0.0)  # the motor stands still
    if settings.run == "flapping":
        mean = drive.electrical_power(settings.power_model, point)
        slopes = _power_slopes(settings.power_model, point)
    level = mean + sum(
        slope * (motion.at(name, time) - value)
        for name, value, slope in (
            ("frequency", point.frequency, slopes[0]),
            ("angle", point.angle_of_attack, slopes[1]),
            ("airspeed", point.airspeed, slopes[2]),
        )
    )
    pulse = art.current_ripple if settings.run == "flapping" else 0.0
    shape = drive.current_shape(motion.at("phase", time), pulse)
    power = np.maximum(level, 0.05) * shape
    voltage, current = drive.supply(power, art.source_resistance)
    ripple = art.commutation * np.sin(250.0 * motion.at("phase", time))  # many segments per wing beat
    recorded = current * (1.0 + ripple)
    if art.channel_skew:
        recorded = np.interp(time - art.channel_skew, time, recorded)
    recorded = recorded + art.shunt_offset
    noise = rng.standard_normal((2, n))
    true_mean = float(np.mean(power))
    return (
        # The voltage trace is offset to use a quarter of the range, the current range follows its peak.
        _scope(voltage + 0.002 * noise[0], 5.12 / 4.0, art.scope_bits, top=5.12),
        _scope(recorded + 0.001 * noise[1], _range_above(float(recorded.max())), art.scope_bits),
        true_mean,
    )


def _power_slopes(model: str, point: aero.Point) -> tuple[float, float, float]:
    """Change of the mean power with frequency, angle and airspeed by central differences."""
    slopes = []
    for field, step in (("frequency", 0.1), ("angle_of_attack", 0.01), ("airspeed", 0.05)):
        ends = [
            drive.electrical_power(model, aero.Point(**{**vars(point), field: getattr(point, field) + d}))
            for d in (step, -step)
        ]
        slopes.append((ends[0] - ends[1]) / (2.0 * step))
    return slopes[0], slopes[1], slopes[2]


def _scope(values: Array, span: float, bits: int, top: float | None = None) -> Array:
    least = span / 2**bits
    limit = span if top is None else top
    return np.asarray(np.clip(np.round(values / least) * least, -limit, limit))


def _range_above(peak: float) -> float:
    """Range of the scope that holds `peak`, in the 1-2-4 steps of its divisions."""
    return float(0.64 * 2.0 ** np.ceil(np.log2(max(1.1 * peak, 0.64) / 0.64)))


def _camera(
    settings: Synthesis, motion: Motion, clock: Clock, rng: np.random.Generator
) -> tuple[Array, Array]:
    art = settings.artefacts
    n = round(settings.seconds * settings.instruments.camera_rate)
    stamps = np.arange(n) / settings.instruments.camera_rate
    noise = np.radians(art.pixel_noise_deg) * rng.standard_normal(n)
    values = motion.at("angle", clock.true(stamps)) + noise
    chance = rng.random(n)
    repeats = np.where(chance < art.frame_drop, 0, 1)
    repeats[chance > 1.0 - art.frame_duplicate] = 2
    stamps = stamps + art.rolling_stamp * np.mod(stamps * ROLLING, 1.0)
    return np.repeat(stamps, repeats), np.repeat(values, repeats)


def _tunnel(settings: Synthesis, motion: Motion, clock: Clock) -> tuple[Array, Array]:
    n = round(settings.seconds * settings.instruments.wind_rate)
    stamps = np.arange(n) / settings.instruments.wind_rate
    return stamps, motion.at("airspeed", clock.true(stamps)) / (1.0 + settings.artefacts.blockage)


def _truth(settings: Synthesis, motion: Motion, clocks: dict[str, Clock], power: float, gain: float) -> Truth:
    spread = settings.scatter
    inside = (motion.time >= 0.0) & (motion.time <= settings.seconds)
    along, normal = air_loads(settings, motion, motion.time[inside])
    lift, drag = aero.wind_axes(along, normal, motion.angle[inside])
    airspeed_sigma = max(spread.airspeed_relative * settings.airspeed, spread.airspeed_least)
    slow = slow_angle(settings)
    rocking = np.radians(spread.angle_rocking_deg)
    pixel = np.radians(settings.artefacts.pixel_noise_deg)
    angle_sigma = np.degrees(np.sqrt(slow**2 + rocking**2 / 2.0 + pixel**2))
    turns = np.interp([0.0, settings.seconds], motion.time, motion.phase) / (2.0 * np.pi)
    return Truth(
        synthetic=True,
        seed=settings.seed,
        power_model=settings.power_model,
        flapping_frequency_hz={
            "mean": setting_of(settings).frequency,
            "std": setting_of(settings).frequency * spread.frequency_relative,
            "realised_mean": float(motion.frequency[inside].mean()),
        },
        angle_of_attack_deg={
            "mean": settings.angle_of_attack_deg,
            "std": float(angle_sigma),
            "realised_mean": float(np.degrees(motion.angle[inside].mean())),
        },
        forward_velocity_m_s={
            "mean": settings.airspeed,
            "std": airspeed_sigma,
            "realised_mean": float(motion.airspeed[inside].mean()),
        },
        lift_n=float(lift.mean()),
        drag_n=float(drag.mean()),
        power_w=power,
        cycles=int(np.floor(turns[1] - turns[0])),
        clock_offsets_s={name: clock.offset for name, clock in clocks.items() if name != "force"},
        clock_skews={name: clock.skew for name, clock in clocks.items() if name != "force"},
        force_gain=gain,
    )
