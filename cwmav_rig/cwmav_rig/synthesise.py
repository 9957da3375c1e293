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

from cwmav_rig.physics import aero, drive, scatter, sensor
from cwmav_rig.synthesis_settings import Synthesis

Array = NDArray[np.float64]
FINE_RATE = 2000.0  # Hz, grid of the true motion
ROLLING = 0.37  # Hz, beat of the camera's read-out with its clock
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
    motion = _motion(settings, rngs[0])
    clocks = _clocks(settings, rngs[1])
    force, overload, tares, gain = _force(settings, motion, rngs[2])
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


def _motion(settings: Synthesis, rng: np.random.Generator) -> Motion:
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
    slow = _slow_angle(settings)
    angle = np.radians(settings.angle_of_attack_deg) + rocking * np.sin(phase + 0.7)
    angle = angle + scatter.memory_process(n, step, spread.angle_memory, slow, rng)
    sigma = max(spread.airspeed_relative * settings.airspeed, spread.airspeed_least)
    wind = scatter.memory_process(n, step, spread.airspeed_memory, sigma, rng)
    airspeed = np.zeros(n) if settings.run == "wind_off" else settings.airspeed + wind
    return Motion(np.asarray(time, np.float64), frequency, phase, angle, airspeed)


def _slow_angle(settings: Synthesis) -> float:
    """Give the deviation of the slow part [rad]: what rocking and camera noise leave of the total."""
    spread = settings.scatter
    rest = spread.angle_deg**2 - spread.angle_rocking_deg**2 / 2.0 - settings.artefacts.pixel_noise_deg**2
    return float(np.radians(np.sqrt(max(rest, 0.0))))


def _clocks(settings: Synthesis, rng: np.random.Generator) -> dict[str, Clock]:
    art = settings.artefacts
    clocks = {"force": Clock(0.0, 0.0)}
    for name in CLOCKS[1:]:
        offset, skew = rng.uniform(-1.0, 1.0, 2)
        clocks[name] = Clock(float(offset * art.clock_offset), float(skew * art.clock_skew))
    return clocks


def _air_loads(settings: Synthesis, motion: Motion, time: Array) -> tuple[Array, Array]:
    """Body forces at `time` (n,): the cycle at the setting and the change of its mean with the controls."""
    if settings.run == "wind_off":
        return np.zeros(len(time)), np.zeros(len(time))
    point = _setting(settings)
    phase = motion.at("phase", time)
    table = np.linspace(0.0, 2.0 * np.pi, 721)
    cycle = aero.body_forces(point, table, settings.air_density)
    turn = np.mod(phase, 2.0 * np.pi)
    along, normal = np.interp(turn, table, cycle[0]), np.interp(turn, table, cycle[1])
    for name, value, step in (
        ("frequency", point.frequency, 0.1),
        ("angle", point.angle_of_attack, 0.01),
        ("airspeed", point.airspeed, 0.05),
    ):
        if name == "frequency" and settings.run != "flapping":
            continue
        slope = _slope(point, name, step, settings.air_density)
        change = motion.at(name, time) - value
        along, normal = along + slope[0] * change, normal + slope[1] * change
    return along, normal


def _slope(point: aero.Point, name: str, step: float, density: float) -> Array:
    field = {"frequency": "frequency", "angle": "angle_of_attack", "airspeed": "airspeed"}[name]
    values = [
        np.array(aero.mean_forces(aero.Point(**{**vars(point), field: getattr(point, field) + d}), density))
        for d in (step, -step)
    ]
    return np.asarray((values[0] - values[1]) / (2.0 * step))


def _setting(settings: Synthesis) -> aero.Point:
    return aero.Point(
        settings.flapping_frequency if settings.run == "flapping" else 0.0,
        float(np.radians(settings.angle_of_attack_deg)),
        settings.airspeed,
    )


def _force(
    settings: Synthesis, motion: Motion, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_], tuple[tuple[float, Array], ...], float]:
    art, ins = settings.artefacts, settings.instruments
    n = round(settings.seconds * ins.force_rate)
    time = np.arange(n) / ins.force_rate
    along, normal = _air_loads(settings, motion, time)
    phase, frequency = motion.at("phase", time), motion.at("frequency", time)
    shake = art.inertia * (frequency / 12.0) ** 2
    normal = normal + shake * (np.cos(phase) + 0.5 * np.cos(2.0 * phase + 0.4))
    along = along + 0.3 * shake * np.cos(2.0 * phase + 1.1)
    angle = motion.at("angle", time)
    along, normal = along - art.weight * np.sin(angle), normal - art.weight * np.cos(angle)
    if art.saturation:
        normal = normal + _spikes(phase, art.saturation)
    if art.resonance_frequency:
        along = sensor.resonance(along, ins.force_rate, art.resonance_frequency, art.resonance_damping)
        normal = sensor.resonance(normal, ins.force_rate, art.resonance_frequency, art.resonance_damping)
    gain, offsets = _sensor(settings, rng)
    zero_at = np.array([-2.0 - ins.tare_seconds, settings.seconds + 2.0])
    everything = np.concatenate(([zero_at[0]], time, [zero_at[1]]))
    drift = np.stack(
        [sensor.bias(everything, art.bias_drift, art.warm_up, art.thermal, rng) for _ in range(3)], axis=1
    )
    pick_up = sensor.mains(time, art.mains, art.mains_frequency, float(rng.uniform(0, 2 * np.pi)))
    pick_up = pick_up + art.pwm * np.sin(2.0 * np.pi * art.pwm_frequency * time)
    body = np.stack([along, np.zeros(n), normal], axis=1)
    chain = _Chain(settings, gain, offsets, rng)
    force, overload = chain.record(body, drift[1:-1] + pick_up[:, None])
    tares: list[tuple[float, Array]] = []
    if settings.run == "wind_off":
        return force, overload, (), gain
    for start, zero in zip(zero_at, (drift[0], drift[-1]), strict=True):
        tares.append((float(start), chain.record(_hanging(settings), zero)[0]))
    return force, overload, tuple(tares), gain


def _sensor(settings: Synthesis, rng: np.random.Generator) -> tuple[float, Array]:
    """Gain and zero of the force sensor: of this recording, or those of a sensor used for several."""
    art = settings.artefacts

    def draw(source: np.random.Generator) -> tuple[float, Array]:
        gain = 1.0 + art.gain_error * float(source.standard_normal())
        return gain, source.uniform(-1.0, 1.0, 6) * art.force_offset * np.array([1, 1, 1, 0.01, 0.01, 0.01])

    drawn = draw(rng)  # also when not used, so that the rest of the recording stays the same
    return drawn if settings.sensor_seed is None else draw(np.random.default_rng(settings.sensor_seed))


def _hanging(settings: Synthesis) -> Array:
    """Force on the sensor with wind and drive off at the same attitude, (m, 3) [N]."""
    n = round(settings.instruments.tare_seconds * settings.instruments.force_rate)
    angle = np.radians(settings.angle_of_attack_deg)
    weight = settings.artefacts.weight
    return np.tile([-weight * np.sin(angle), 0.0, -weight * np.cos(angle)], (n, 1))


def _spikes(phase: Array, peak: float) -> Array:
    """Short overloads as the wings clap: half a millisecond wide at 12 Hz, once in 50 cycles."""
    cycle = np.floor(phase / (2.0 * np.pi))
    near = np.abs(np.mod(phase, 2.0 * np.pi) - np.pi) < 0.04
    return np.where(near & (np.mod(cycle, 50.0) == 25.0), peak, 0.0)


class _Chain:
    """The force sensor: misalignment, gain, zero, noise, resolution, range, the same for run and tare."""

    def __init__(self, settings: Synthesis, gain: float, offsets: Array, rng: np.random.Generator) -> None:
        self.art, self.ins = settings.artefacts, settings.instruments
        self.gain, self.offsets, self.rng = gain, offsets, rng

    def record(self, body: Array, zero: Array) -> tuple[Array, NDArray[np.bool_]]:
        tilt, yaw = np.radians(self.art.misalignment_deg), np.radians(self.art.misalignment_yaw_deg)
        pitched = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
        yawed = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        force = self.gain * (body @ pitched.T @ yawed.T) + zero + self.offsets[:3]
        moment = np.stack([0.002 * force[:, 1], -0.030 * force[:, 2], 0.030 * force[:, 1]], axis=1)
        moment = moment + self.offsets[3:]
        force = force + self.art.white_noise * self.rng.standard_normal(force.shape)
        moment = moment + 0.01 * self.art.white_noise * self.rng.standard_normal(moment.shape)
        overload = np.zeros(len(force), bool)
        values = np.empty((len(force), 6))
        for k, full in enumerate((self.ins.range_xy, self.ins.range_xy, self.ins.range_z)):
            values[:, k], clipped = sensor.digitise(force[:, k], self.art.least_count, full)
            overload |= clipped
        for k in range(3):
            values[:, 3 + k], _ = sensor.digitise(moment[:, k], 0.005 * self.art.least_count, 0.05)
        return values, overload


def _power(
    settings: Synthesis, motion: Motion, clock: Clock, rng: np.random.Generator
) -> tuple[Array, Array, float]:
    art, ins = settings.artefacts, settings.instruments
    n = round(settings.seconds * ins.power_rate)
    time = clock.true(np.arange(n) / ins.power_rate)
    point = _setting(settings)
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
    shape = drive.current_shape(motion.at("phase", time), art.current_ripple)
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
    along, normal = _air_loads(settings, motion, motion.time[inside])
    lift, drag = aero.wind_axes(along, normal, motion.angle[inside])
    airspeed_sigma = max(spread.airspeed_relative * settings.airspeed, spread.airspeed_least)
    slow = _slow_angle(settings)
    rocking = np.radians(spread.angle_rocking_deg)
    pixel = np.radians(settings.artefacts.pixel_noise_deg)
    angle_sigma = np.degrees(np.sqrt(slow**2 + rocking**2 / 2.0 + pixel**2))
    turns = np.interp([0.0, settings.seconds], motion.time, motion.phase) / (2.0 * np.pi)
    return Truth(
        synthetic=True,
        seed=settings.seed,
        power_model=settings.power_model,
        flapping_frequency_hz={
            "mean": _setting(settings).frequency,
            "std": _setting(settings).frequency * spread.frequency_relative,
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
