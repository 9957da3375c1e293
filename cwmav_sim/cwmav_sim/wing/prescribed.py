# SPDX-License-Identifier: Apache-2.0
"""Wings that follow the clapping law exactly: position, velocity and acceleration of every node.

Wind frame: x with the stream, z up, y to the right wing tip. The body axis points upstream and is pitched
nose up by the angle of attack. Span and chord directions of a wing at stroke angle phi and twist tau are

    e_r = cos(phi) y + sin(phi) up,     n = -sin(phi) y + cos(phi) up,     c = -forward cos(tau) + n sin(tau),

and a node sits at r e_r + s c from the hinge point, tau being linear in r.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_sim.kinematics import ClappingLaw, Kinematics, tip_twist
from cwmav_sim.taylor import Taylor, sin_cos
from cwmav_sim.wing.geometry import PanelMesh, WingPlanform, mesh_panel
from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState

Triple = tuple[FloatArray, FloatArray, FloatArray]  # value, rate, acceleration


@dataclass(frozen=True)
class Attitude:
    """Point of flight of the vehicle: frequency [Hz], angle of attack [rad], airspeed [m/s]."""

    frequency: float
    angle_of_attack: float
    airspeed: float


class ClappingWings:
    """Two pairs of clapping wings (one pair in the half model) behind the sheet protocol.

    Parameters
    ----------
    planform : WingPlanform
        One panel; all are equal.
    kinematics : Kinematics
        Clapping law and prescribed feathering.
    attitude : Attitude
        Frequency, angle of attack and airspeed.
    spacing : float
        Distance between mesh nodes [m].
    half : bool
        Only the wings on the side y > 0; the plane y = 0 is a plane of symmetry.
    moving : bool
        False holds the wings still in their mean position.
    """

    def __init__(
        self,
        planform: WingPlanform,
        kinematics: Kinematics,
        attitude: Attitude,
        *,
        spacing: float,
        half: bool,
        moving: bool = True,
    ) -> None:
        self.planform, self.kinematics, self.attitude = planform, kinematics, attitude
        self._moving = moving
        self._law = ClappingLaw(kinematics, attitude.frequency)
        self._mesh = mesh_panel(planform, spacing)
        self._panels = _panels(half)
        count = len(self._mesh.r)
        tri = self._mesh.triangles
        self._triangles = np.concatenate([tri + k * count for k in range(len(self._panels))])
        self._panel = np.repeat(np.arange(len(self._panels), dtype=np.int64), len(tri))

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle, shape (m, 3)."""
        return self._triangles

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle, shape (m,)."""
        return self._panel

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        return tuple(name for name, _, _ in self._panels)

    @property
    def period(self) -> float:
        """Flapping period [s]."""
        return 1.0 / self.attitude.frequency

    def state(self, t: float) -> SheetState:
        """Return position, velocity and acceleration of the nodes at time ``t`` [s]."""
        opening = self._law.opening(t if self._moving else -1.0)
        along = self.attitude.airspeed * math.cos(self.attitude.angle_of_attack)
        twist = tip_twist(
            opening,
            self.kinematics,
            self.attitude.frequency,
            along,
            self.planform.length,
            self.planform.root_chord,
        )
        parts = [self._place(opening.truncated(2), twist, up, side) for _, up, side in self._panels]
        x, v, a = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return SheetState(x, v, a)

    def _place(self, opening: Taylor, twist: Taylor, up: float, side: float) -> Triple:
        """Nodes of one panel; ``up`` is +1 for the upper wing, ``side`` +1 for the right one."""
        stroke = up * opening + self.kinematics.dihedral
        sine, cosine = sin_cos(stroke)
        forward, upward = _body_axes(self.attitude.angle_of_attack)
        right = np.array([0.0, side, 0.0])
        e_r = _combine((cosine, right), (sine, upward))
        normal = _combine((-sine, right), (cosine, upward))
        turn_sine, turn_cosine = _sin_cos_linear(up * twist, self._mesh.r / self.planform.length)
        return _assemble(self._mesh, e_r, normal, forward, turn_sine, turn_cosine)


def _panels(half: bool) -> tuple[tuple[str, float, float], ...]:
    right = (("upper_right", 1.0, 1.0), ("lower_right", -1.0, 1.0))
    return right if half else (*right, ("upper_left", 1.0, -1.0), ("lower_left", -1.0, -1.0))


def _body_axes(angle_of_attack: float) -> tuple[FloatArray, FloatArray]:
    """Forward (thrust) and upward axis of the body in the wind frame."""
    c, s = math.cos(angle_of_attack), math.sin(angle_of_attack)
    return np.array([-c, 0.0, s]), np.array([s, 0.0, c])


def _combine(*terms: tuple[Taylor, FloatArray]) -> Triple:
    first, second, third = (sum(f.derivative(k) * axis for f, axis in terms) for k in range(3))
    return np.asarray(first), np.asarray(second), np.asarray(third)


def _sin_cos_linear(tip: Taylor, share: FloatArray) -> tuple[Triple, Triple]:
    """Sine and cosine of ``tip * share`` with two time derivatives, per node."""
    angle, rate, acceleration = (tip.derivative(k) * share for k in range(3))
    s, c = np.sin(angle), np.cos(angle)
    sine = (s, c * rate, c * acceleration - s * rate**2)
    cosine = (c, -s * rate, -s * acceleration - c * rate**2)
    return sine, cosine


def _assemble(
    mesh: PanelMesh, e_r: Triple, normal: Triple, forward: FloatArray, sine: Triple, cosine: Triple
) -> Triple:
    """Differentiate r e_r + s (-forward cos(tau) + n sin(tau)) by the product rule."""
    s = mesh.s[:, None]
    r = mesh.r[:, None]

    def back(k: int) -> FloatArray:
        return -s * cosine[k][:, None] * forward

    def lift(i: int, j: int) -> FloatArray:
        return s * sine[i][:, None] * normal[j]

    x = r * e_r[0] + back(0) + lift(0, 0)
    v = r * e_r[1] + back(1) + lift(1, 0) + lift(0, 1)
    a = r * e_r[2] + back(2) + lift(2, 0) + 2.0 * lift(1, 1) + lift(0, 2)
    return x, v, a
