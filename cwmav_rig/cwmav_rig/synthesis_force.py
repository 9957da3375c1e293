# SPDX-License-Identifier: Apache-2.0
"""What the force sensor of a synthetic recording shows, in the run and in the wind-off records beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.physics import aero, sensor
from cwmav_rig.synthesis_motion import Motion, setting_of
from cwmav_rig.synthesis_settings import Synthesis

Array = NDArray[np.float64]


def air_loads(settings: Synthesis, motion: Motion, time: Array) -> tuple[Array, Array]:
    """Body forces at `time` (n,): the cycle at the setting, its mean changing with the controls."""
    if settings.run == "wind_off":
        return np.zeros(len(time)), np.zeros(len(time))
    point = setting_of(settings)
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


def force_of(
    settings: Synthesis, motion: Motion, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_], tuple[tuple[float, Array], ...], float]:
    """Give force and moment (n, 6), overload flags (n,), wind-off records with begin [s], and the gain."""
    art, ins = settings.artefacts, settings.instruments
    n = round(settings.seconds * ins.force_rate)
    time = np.arange(n) / ins.force_rate
    along, normal = air_loads(settings, motion, time)
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
    heating = art.thermal if settings.run == "flapping" else 0.0  # the motor warms the sensor
    drift = np.stack(
        [sensor.bias(everything, art.bias_drift, art.warm_up, heating, rng) for _ in range(3)], axis=1
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
