# SPDX-License-Identifier: Apache-2.0
"""Lift and drag per cycle from the force on the sensor: tare, gain, turn into the axes of the wind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.blocks import Block
from cwmav_rig.cycles import Cycles, cycle_means
from cwmav_rig.topic_map import TopicMap
from cwmav_rig.uncertainty import Spread, spread_of_cycles

Array = NDArray[np.float64]
Tares = tuple[tuple[float, Array], ...]


def lift_and_drag(
    force: Block, cycles: Cycles, topic_map: TopicMap, tares: Tares, angle: float | None
) -> tuple[Spread | None, Spread | None, list[str]]:
    """Give the spread of lift and drag over the cycles, and why there is none.

    Parameters
    ----------
    tares
        Time [s] and mean wrench (6,) of wind-off records at the same attitude.
    angle
        Mean angle of attack [rad]; needed when the sensor pitches with the vehicle.

    Notes
    -----
    The sensor feels aerodynamic force plus weight. A wind-off record at the same attitude holds the weight
    and the zero of the sensor; records before and after give its drift, taken as linear in time. Inertial
    forces have no mean over whole cycles.
    """
    role = topic_map.force
    if not tares and topic_map.tare != "none":
        return None, None, ["lift: refused, no wind-off tare; map one, or say tare: none"]
    if role.frame == "body" and angle is None:
        return (
            None,
            None,
            ["lift: refused, the sensor pitches with the vehicle and no angle of attack is recorded"],
        )
    middle = 0.5 * (cycles.bounds[1:] + cycles.bounds[:-1])
    forward = _axis(force, role.axis_thrust, cycles) - _axis_tare(tares, role.axis_thrust, middle)
    upward = _axis(force, role.axis_lift, cycles) - _axis_tare(tares, role.axis_lift, middle)
    pitch = np.radians(role.pitch_deg) + (angle if role.frame == "body" and angle is not None else 0.0)
    lift, drag = to_wind_axes(role.gain * forward, role.gain * upward, pitch)
    notes = (
        []
        if tares
        else ["lift: no tare was subtracted, as the topic map says; weight and zero are part of it"]
    )
    return _spread(lift, cycles), _spread(drag, cycles), notes


def to_wind_axes(forward: Array, upward: Array, pitch: float) -> tuple[Array, Array]:
    """Turn sensor forces into lift (normal to the wind, up) and drag (downstream); nose-up `pitch` [rad]."""
    return upward * np.cos(pitch) + forward * np.sin(pitch), upward * np.sin(pitch) - forward * np.cos(pitch)


def tare_at(tares: Tares, time: Array) -> Array:
    """Wrench of the wind-off records at `time` (n,), (n, 6): linear between them, zero without any."""
    if not tares:
        return np.zeros((len(time), 6))
    stamps = np.array([stamp for stamp, _ in tares])
    values = np.stack([value for _, value in tares])
    return np.stack([np.interp(time, stamps, values[:, k]) for k in range(6)], axis=1)


def _axis(force: Block, axis: str, cycles: Cycles) -> Array:
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * cycle_means(force, "f" + axis[-1], cycles.bounds)


def _axis_tare(tares: Tares, axis: str, time: Array) -> Array:
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * tare_at(tares, time)[:, "xyz".index(axis[-1])]


def _spread(values: Array, cycles: Cycles) -> Spread:
    return spread_of_cycles(np.where(cycles.good, values, np.nan))
