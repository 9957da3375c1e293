# SPDX-License-Identifier: Apache-2.0
"""Lift and drag per cycle from the force on the sensor: zero, gain, turn into the axes of the wind."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.blocks import Block, Series
from cwmav_rig.calibration import TareError, TareRun, Zero, zero_for
from cwmav_rig.cycles import Cycles, cycle_means
from cwmav_rig.topic_map import ForceRole, TopicMap

Array = NDArray[np.float64]

LARGEST_DRIFT = 0.05  # N over the run; a line between two wind-off runs does not describe more


@dataclass(frozen=True)
class Loads:
    """Lift and drag, (m,) each [N], and how they came about; None with the reason in `notes`.

    Attributes
    ----------
    zero
        What was taken off; None where the map says that there is no tare.
    pitch
        Pitch of the sensor to the wind [rad], nose up.
    pitch_std
        Standard uncertainty of the part of it that belongs to the sensor [rad].
    """

    lift: Array | None
    drag: Array | None
    notes: tuple[str, ...]
    zero: Zero | None = None
    pitch: float = 0.0
    pitch_std: float = 0.0


def lift_and_drag(
    force: Block,
    cycles: Cycles,
    topic_map: TopicMap,
    tares: tuple[TareRun, ...],
    angle: float | None,
    temperature: Series | None = None,
) -> Loads:
    """Give lift and drag of every cycle, or say why there is none.

    Parameters
    ----------
    tares
        Wind-off runs.
    angle
        Mean angle of attack [rad]; needed when the sensor pitches with the vehicle.
    temperature
        Of the sensor [deg C], where it was recorded.

    Notes
    -----
    The sensor feels aerodynamic force plus weight; see :mod:`cwmav_rig.calibration` for what the wind-off
    runs tell. Inertial forces have no mean over whole cycles.
    """
    role = topic_map.force
    if not tares and topic_map.tare != "none":
        return _refused("no wind-off tare; map one, or say tare: none")
    if role.frame == "body" and angle is None:
        return _refused("the sensor pitches with the vehicle and no angle of attack is recorded")
    middle = 0.5 * (cycles.bounds[1:] + cycles.bounds[:-1])
    mean = np.stack([cycle_means(force, name, cycles.bounds) for name in ("fx", "fy", "fz")], axis=1)
    mean = mean - thermal_zero(role, temperature, middle)
    zero = None
    notes = ["lift: no tare was subtracted, as the topic map says; weight and zero are part of it"]
    if tares:
        corrected = tuple(_at_reference(run, role, temperature) for run in tares)
        # A sensor in wind axes does not turn: its wind-off runs are alike whatever their angle.
        attitude = angle if role.frame == "body" else None
        try:
            zero = zero_for(
                corrected,
                attitude,
                (float(cycles.bounds[0]), float(cycles.bounds[-1])),
                role.axis_thrust,
                role.axis_lift,
            )
        except TareError as error:
            return _refused(str(error))
        largest = float(np.nanmax(np.abs(np.append(zero.drift, 0.0))))
        if largest > LARGEST_DRIFT:
            return _refused(
                f"the zero drifts by {largest * 1e3:.0f} mN over the run;"
                f" at most {LARGEST_DRIFT * 1e3:g} mN is allowed"
            )
        mean = mean - zero.at(middle)[:, :3]
        notes = []
    pitch, pitch_std = np.radians(role.pitch_deg), np.radians(role.pitch_std_deg)
    if role.alignment == "tare":
        if zero is None or zero.pitch is None or zero.pitch_std is None:
            return _refused("alignment: tare needs wind-off runs at two angles of attack or more")
        pitch, pitch_std = zero.pitch, zero.pitch_std
    pitch += angle if role.frame == "body" and angle is not None else 0.0
    forward, upward = (role.gain * _along(mean, axis) for axis in (role.axis_thrust, role.axis_lift))
    lift, drag = to_wind_axes(forward, upward, pitch)
    return Loads(lift, drag, tuple(notes), zero, float(pitch), float(pitch_std))


def to_wind_axes(forward: Array, upward: Array, pitch: float) -> tuple[Array, Array]:
    """Turn sensor forces into lift (normal to the wind, up) and drag (downstream); nose-up `pitch` [rad]."""
    return upward * np.cos(pitch) + forward * np.sin(pitch), upward * np.sin(pitch) - forward * np.cos(pitch)


def thermal_zero(role: ForceRole, temperature: Series | None, time: Array) -> Array:
    """Shift of the zero with temperature at `time` (n,), (n, 3) [N]; its reference cancels with the tare."""
    if temperature is None or not len(temperature.values):
        return np.zeros((len(time), 3))
    kelvin = np.interp(time, temperature.time, temperature.values)
    return np.asarray(np.outer(kelvin, role.temperature_coefficient))


def _at_reference(run: TareRun, role: ForceRole, temperature: Series | None) -> TareRun:
    """Take the shift with temperature off a wind-off run, as off the flapping run."""
    if temperature is None or not len(temperature.values):
        return run
    shift = thermal_zero(role, temperature, np.array([run.time]))[0]
    if run.temperature is not None:
        shift = run.temperature * np.array(role.temperature_coefficient)
    wrench = np.array(run.wrench, float)
    wrench[:3] -= shift
    return replace(run, wrench=wrench)


def _refused(reason: str) -> Loads:
    return Loads(None, None, (f"lift: refused, {reason}",))


def _along(force: Array, axis: str) -> Array:
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * force[:, "xyz".index(axis[-1])]
