# SPDX-License-Identifier: Apache-2.0
"""Blade-element air loads of the clapping wings, as a source of plausible rig signals.

Four half wings sweep sinusoidally about the body axis, the upper pair against the lower one. Each strip
sees the wind and its own stroke velocity; the section feathers by a share of the flow angle that grows
along the span. Coefficients ``CL = A sin 2a``, ``CD = D0 + B (1 - cos 2a)`` (Dickinson, Lehmann & Sane 1999
in form).

The five constants are one least-squares fit to seven published lifts of the paper's Table 3 (U = 1.5 m/s left
out, AoA = -10 deg taken as negative) and a static thrust of 0.144 N at 16 Hz; it leaves 0.027 N rms.
It is a signal generator, not a prediction: the simulation package does not know it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LIFT_SLOPE = 0.649  # A
DRAG_RISE = 0.564  # B
DRAG_FLOOR = 0.020  # D0
FEATHERING = 0.739  # share of the flapping flow angle that the tip section follows
INCIDENCE = 0.1174  # rad, offset of the sections to the body axis

SPAN_INNER, SPAN_OUTER = 0.020, 0.140  # m
ROOT_CHORD, STRAIGHT_TO = 0.085, 0.100  # m
SWEEP = np.radians(37.5)  # sweep of each wing: half of the opening angle of 75 deg
STRIPS = 24


@dataclass(frozen=True)
class Point:
    """A setting of the rig: flapping frequency [Hz], angle of attack [rad], airspeed [m/s]."""

    frequency: float
    angle_of_attack: float
    airspeed: float


def strips() -> tuple[Array, Array]:
    """Give radius and area of the strips of one half wing, (24,) [m], (24,) [m2]."""
    edges = np.linspace(SPAN_INNER, SPAN_OUTER, STRIPS + 1)
    radius = 0.5 * (edges[1:] + edges[:-1])
    taper = np.clip((radius - STRAIGHT_TO) / (SPAN_OUTER - STRAIGHT_TO), 0.0, 1.0)
    return radius, ROOT_CHORD * np.sqrt(1.0 - taper**2) * np.diff(edges)


def body_forces(point: Point, phase: Array, density: float = 1.225) -> tuple[Array, Array]:
    """Force of the air on the vehicle along the body axes x (forward) and z (up), (n,) each [N].

    Parameters
    ----------
    phase
        (n,) phase of the stroke [rad]; the wings are closed at 0.
    """
    radius, area = strips()
    wind_x = -point.airspeed * np.cos(point.angle_of_attack)
    wind_z = point.airspeed * np.sin(point.angle_of_attack)
    rate = np.pi * point.frequency * SWEEP * np.sin(phase)  # d/dt of SWEEP (1 - cos) / 2
    along = np.zeros_like(rate)
    normal = np.zeros_like(rate)
    for side in (1.0, -1.0):  # upper and lower pair
        vz = wind_z - side * rate[:, None] * radius
        speed = np.hypot(wind_x, vz)
        flow = np.arctan2(vz, -wind_x)
        angle = flow - FEATHERING * radius / SPAN_OUTER * (flow - point.angle_of_attack) + INCIDENCE
        load = density * speed * area  # two half wings of 0.5 rho V^2 dA, one V kept for the direction
        lift = LIFT_SLOPE * np.sin(2.0 * angle)
        drag = DRAG_FLOOR + DRAG_RISE * (1.0 - np.cos(2.0 * angle))
        along += (load * (drag * wind_x + lift * vz)).sum(axis=1)
        normal += (load * (drag * vz - lift * wind_x)).sum(axis=1)
    return along, normal


def mean_forces(point: Point, density: float = 1.225) -> tuple[float, float]:
    """Cycle means of :func:`body_forces` [N]."""
    along, normal = body_forces(point, np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False), density)
    return float(along.mean()), float(normal.mean())


def wind_axes(along: Array, normal: Array, angle_of_attack: Array | float) -> tuple[Array, Array]:
    """Turn body forces into lift (normal to the wind, up) and drag (along the wind) [N]."""
    sine, cosine = np.sin(angle_of_attack), np.cos(angle_of_attack)
    return normal * cosine + along * sine, normal * sine - along * cosine


def mean_lift(point: Point, density: float = 1.225) -> float:
    """Cycle mean of lift [N]."""
    along, normal = mean_forces(point, density)
    return normal * float(np.cos(point.angle_of_attack)) + along * float(np.sin(point.angle_of_attack))
