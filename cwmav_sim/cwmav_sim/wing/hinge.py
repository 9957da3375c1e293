# SPDX-License-Identifier: Apache-2.0
"""The driven root: hinges that swing by the clapping law, and points held by the body.

A point of a panel has hinge coordinates (r, s, n): along the span, along the chord, along the normal. The
axes swing about the body axis by the stroke angle, in the same frame and with the same panel names as
:class:`cwmav_sim.wing.prescribed.ClappingWings`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.kinematics import ClappingLaw, Kinematics
from cwmav_sim.wing.drive import Carrier, Driven
from cwmav_sim.wing.rotation import cross, turn
from cwmav_sim.wing.sheet import FloatArray, IntArray

_REMEMBERED = 4  # instants a step asks for more than once


@dataclass(frozen=True)
class Swing:
    """Hinge frames at one instant: axes (g, 3, 3), columns span, chord, normal; spin, its rate (g, 3)."""

    axes: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


@dataclass(frozen=True)
class Panel:
    """One wing panel: ``up`` is +1 for an upper wing, ``side`` +1 for a right one."""

    name: str
    up: float
    side: float


def panels(half: bool) -> tuple[Panel, ...]:
    """Return the panels of the full vehicle or of the half y > 0."""
    right = (Panel("upper_right", 1.0, 1.0), Panel("lower_right", -1.0, 1.0))
    return right if half else (*right, Panel("upper_left", 1.0, -1.0), Panel("lower_left", -1.0, -1.0))


@dataclass(frozen=True)
class Hinges:
    """Hinge frames of every panel against time.

    Parameters
    ----------
    kinematics : Kinematics
        Clapping law.
    frequency : float
        Flapping frequency [Hz].
    angle_of_attack : float
        Angle of attack [rad].
    panels : tuple of Panel
        Panels, one frame each.
    moving : bool
        False holds the hinges in the middle of the stroke.
    """

    kinematics: Kinematics
    frequency: float
    angle_of_attack: float
    panels: tuple[Panel, ...]
    moving: bool = True

    def at(self, t: float) -> Swing:
        """Return the frames at time ``t`` [s]."""
        opening = ClappingLaw(self.kinematics, self.frequency).opening(t if self.moving else -1.0, order=2)
        angle, rate, rise = (opening.derivative(k) for k in range(3))
        forward, upward = _body_axes(self.angle_of_attack)
        axes, spin, spin_rate = [], [], []
        for panel in self.panels:
            raised = panel.up * angle + self.kinematics.dihedral
            right = np.array([0.0, panel.side, 0.0])
            c, s = math.cos(raised), math.sin(raised)
            axes.append(np.stack([c * right + s * upward, -forward, -s * right + c * upward], axis=1))
            pivot = panel.up * cross(right, upward)
            spin.append(pivot * rate)
            spin_rate.append(pivot * rise)
        return Swing(np.array(axes), np.array(spin), np.array(spin_rate))


@dataclass(frozen=True)
class Held:
    """Rows of one kind that a root holds.

    Attributes
    ----------
    nodes : ndarray, shape (h,)
        Node numbers.
    group : ndarray, shape (h,)
        Panel of each.
    place : ndarray, shape (h, 3)
        Hinge coordinates [m].
    swings : ndarray of bool, shape (h,)
        True where the node swings with the hinge, False where the body holds it still.
    """

    nodes: IntArray
    group: IntArray
    place: FloatArray
    swings: NDArray[np.bool_]


class HingedRoot:
    """Drive of flapping wings; implements :class:`cwmav_sim.wing.drive.Drive`.

    Parameters
    ----------
    hinges : Hinges
        Hinge frames.
    held : Held
        Driven nodes.
    bodies, bodies_group : ndarray, shape (b,)
        Driven bodies and their panels; they swing with the hinge.
    reference : ndarray, shape (b, 3, 3)
        Their rotations at ``start``.
    group : ndarray, shape (n + k,)
        Panel of every row of the structure.
    start : float
        Time [s] of the unloaded shape; nodes held by the body stay where they are then.
    """

    def __init__(
        self,
        hinges: Hinges,
        held: Held,
        bodies: IntArray,
        bodies_group: IntArray,
        reference: FloatArray,
        group: IntArray,
        *,
        start: float = 0.0,
    ) -> None:
        self.nodes, self.bodies, self.group = held.nodes, bodies, group
        self._hinges, self._held, self._bodies_group = hinges, held, bodies_group
        self._first = hinges.at(start).axes
        self._reference = reference
        self._still = turn(self._first[held.group], held.place)
        self._recent: dict[float, Swing] = {}

    def at(self, t: float) -> Driven:
        """Return the motion of everything driven at ``t`` [s]."""
        swing, held = self._swing(t), self._held
        group, swings = held.group, held.swings[:, None]
        x = turn(swing.axes[group], held.place)
        v = cross(swing.spin[group], x)
        a = cross(swing.spin_rate[group], x) + cross(swing.spin[group], v)
        bodies = self._bodies_group
        turned = swing.axes[bodies] @ np.swapaxes(self._first[bodies], 1, 2) @ self._reference
        return Driven(
            np.where(swings, x, self._still),
            np.where(swings, v, 0.0),
            np.where(swings, a, 0.0),
            turned,
            swing.spin[bodies],
            swing.spin_rate[bodies],
        )

    def carrier(self, t: float) -> Carrier:
        """Return the hinge frames at ``t`` [s]."""
        swing = self._swing(t)
        return Carrier(swing.axes, swing.spin)

    def _swing(self, t: float) -> Swing:
        if t not in self._recent:
            while len(self._recent) >= _REMEMBERED:
                del self._recent[next(iter(self._recent))]
            self._recent[t] = self._hinges.at(t)
        return self._recent[t]


def _body_axes(angle_of_attack: float) -> tuple[FloatArray, FloatArray]:
    """Forward (thrust) and upward axis of the body in the wind frame."""
    c, s = math.cos(angle_of_attack), math.sin(angle_of_attack)
    return np.array([-c, 0.0, s]), np.array([s, 0.0, c])
