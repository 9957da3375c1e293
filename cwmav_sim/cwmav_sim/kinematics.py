# SPDX-License-Identifier: Apache-2.0
"""The clapping law: stroke angle and feathering of the wings as functions of time.

Phase zero is the clap. The upper wing stands at ``dihedral + opening`` and the lower one at
``dihedral - opening`` about the body axis, where

    opening(t) = g + (Phi/4) (1 + s(t) p(t)),     p = -cos(theta) + a2 (cos(2 theta) - 1),

runs from the clap half gap g to g + Phi/2. Phi is the opening angle between the wings, so each wing
sweeps Phi/2. The harmonic a2 sharpens one reversal, as a crank rocker does; theta is the phase warped so
that the outstroke takes its share of the cycle; s rises smoothly from 0 to 1 at the start of a run.

Feathering is PRESCRIBED here, in place of the passive twist of a film wing: see :func:`tip_twist`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_sim.taylor import Taylor, bounded, sin_cos

_ORDER = 3  # the twist follows the stroke rate, and its own acceleration is wanted


@dataclass(frozen=True)
class Kinematics:
    """Settings of the clapping law."""

    opening_deg: float = setting(
        75.0,
        "largest opening angle between upper and lower wing beyond the clap gap",
        unit="deg",
        gt=0,
        le=120,
    )
    dihedral_deg: float = setting(13.0, "angle of the plane where the wings clap", unit="deg", ge=-30, le=30)
    clap_half_gap_deg: float = setting(
        2.5, "angle of each wing from the clap plane at the clap", unit="deg", gt=0, le=20
    )
    second_harmonic: float = setting(0.04, "second harmonic, as a share of the amplitude", ge=-0.2, le=0.2)
    outstroke_share: float = setting(0.52, "share of the cycle in which the wings open", ge=0.4, le=0.6)
    ramp_cycles: float = setting(0.5, "cycles over which the motion grows from rest", gt=0, le=2)
    twist_fraction: float = setting(
        1.0, "tip twist as a share of the mid-stroke flow angle at the tip (0: flat wings)", ge=0, le=1.5
    )
    twist_limit_deg: float = setting(50.0, "largest tip twist the film allows", unit="deg", gt=0, lt=90)
    inflow_share: float = setting(
        0.53, "axial flow at the wing in still air, as a share of the mean tip speed", gt=0, le=2
    )
    peel_clearance: float = setting(
        0.5, "share of the clap half gap that trailing edges keep clear of the clap plane", ge=0.1, le=1
    )

    @property
    def sweep(self) -> float:
        """Angle swept by each wing [rad]."""
        return math.radians(self.opening_deg) / 2.0

    @property
    def clap_half_gap(self) -> float:
        """Angle of each wing from the clap plane at the clap [rad]."""
        return math.radians(self.clap_half_gap_deg)

    @property
    def dihedral(self) -> float:
        """Angle of the clap plane [rad]."""
        return math.radians(self.dihedral_deg)


def peak_rate(kinematics: Kinematics, frequency: float) -> float:
    """Return the highest stroke rate of one wing in the periodic motion [rad/s]."""
    steps = [k / (400.0 * frequency) for k in range(400)]
    start = kinematics.ramp_cycles / frequency
    law = ClappingLaw(kinematics, frequency)
    return max(abs(law.opening(start + t).derivative(1)) for t in steps)


@dataclass(frozen=True)
class ClappingLaw:
    """Stroke angle of one wing against the clap plane at a given flapping frequency [Hz]."""

    kinematics: Kinematics
    frequency: float

    def __post_init__(self) -> None:
        if not self.frequency > 0:
            raise InputError(f"flapping frequency is {self.frequency:g} Hz; allowed: > 0 Hz")

    def opening(self, t: float, order: int = _ORDER) -> Taylor:
        """Return the angle from the clap plane [rad] as a series about time ``t`` [s]."""
        k = self.kinematics
        time = Taylor.time(t, order)
        travel = self._ramp(time) * self._stroke(time)
        return k.clap_half_gap + 0.5 * k.sweep * (travel + 1.0)

    def _stroke(self, time: Taylor) -> Taylor:
        """Position in the stroke: -1 at the clap, +1 fully open."""
        k = self.kinematics
        turn = 2.0 * math.pi * self.frequency * time
        _, cosine = sin_cos(turn)
        share = k.outstroke_share
        warp = math.pi * (2.0 * share - 1.0) / (1.0 - math.cos(2.0 * math.pi * share))
        theta = turn - warp * (1.0 - cosine)
        _, first = sin_cos(theta)
        _, second = sin_cos(2.0 * theta)
        return k.second_harmonic * (second - 1.0) - first

    def _ramp(self, time: Taylor) -> Taylor:
        """Growth of the motion from rest; its third derivative is continuous, as the twist needs."""
        share = time * (self.frequency / self.kinematics.ramp_cycles)
        if share.c[0] >= 1.0:
            return Taylor([1.0] + [0.0] * time.order)
        if share.c[0] < 0.0:
            return Taylor([0.0] * (time.order + 1))
        square = share * share
        return square * square * (35.0 - 84.0 * share + 70.0 * square - 20.0 * (square * share))


def tip_twist(
    opening: Taylor,
    kinematics: Kinematics,
    frequency: float,
    airspeed: float,
    radius: float,
    root_chord: float,
) -> Taylor:
    """Return the prescribed twist of the wing tip [rad].

    Positive twist turns the trailing edge away from the clap plane.

    A film wing with a stiff leading edge lags behind its stroke until its outer part is nearly aligned
    with the local flow. The law states that outcome instead of computing it: the tip twists in
    proportion to the stroke rate, with the flow angle in mid-stroke ``atan(R rate / V)``,
    V = hypot(axial airspeed, inflow), as amplitude, at most what the film allows. Near the clap the wings
    lie against each other and cannot feather: the twist is multiplied by 1 - (1 - o)^2, o being the share
    of the sweep already opened, and while the wings part it is limited so that the trailing edges stay
    clear of the clap plane by a share of the gap.

    Parameters
    ----------
    opening : Taylor
        Stroke angle from the clap plane [rad], of order n + 1.
    kinematics : Kinematics
        Settings of the twist.
    frequency : float
        Flapping frequency [Hz].
    airspeed : float
        Airspeed along the body axis [m/s].
    radius, root_chord : float
        Wing length from the hinge and root chord [m].

    Returns
    -------
    Taylor
        Twist of the tip, of order n. Inboard it falls linearly to zero at the hinge.
    """
    rate = opening.rate()
    order = rate.order
    peak = math.pi * kinematics.sweep * frequency  # rate of a sinusoid in mid-stroke
    mean_tip_speed = 2.0 * kinematics.sweep * frequency * radius
    axial = math.hypot(airspeed, kinematics.inflow_share * mean_tip_speed)
    flow_angle = math.atan(peak * radius / axial)
    amplitude = min(kinematics.twist_fraction * flow_angle, math.radians(kinematics.twist_limit_deg))
    angle = opening.truncated(order)
    closed = 1.0 - (angle - kinematics.clap_half_gap) / kinematics.sweep
    lag = rate * (closed * closed - 1.0) * (amplitude / peak)
    if lag.c[0] >= 0.0:  # closing: the trailing edge trails on the far side, where there is room
        return lag
    clearance = kinematics.peel_clearance * kinematics.clap_half_gap
    room = (angle - clearance) * (radius / root_chord)
    return bounded(lag, room)
