# SPDX-License-Identifier: Apache-2.0
"""A hovering ellipse in the plane at Re 75."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Fringe
from cwmav_sim.verification.flows import History, plane_flow
from cwmav_sim.verification.outlines import Chain, Pose, half_ellipse, outlines
from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.sheet import FloatArray

_SOURCE = "C. Li, H. Dong, G. Liu, J. Fluids Struct. 58 (2015) 49, as distributed with PetIBM (BSD-3)"


@dataclass(frozen=True)
class HoveringEllipse:
    """Chord 1, highest speed 1, thickness 0.1; x = (A0/2) cos(w t), angle pi/2 + pi/4 sin(w t), A0 = 2.8.

    Two panels, the upper and the lower side, keep the air of each side from the other at the sharp tips.
    Ten particles per chord make the body one particle thick; it needs no more, as a sheet has no thickness of
    its own. Coefficients are on 1/2 rho U^2 c; drag is positive against the motion of the wing.
    """

    name: str = "hovering-ellipse"
    summary: str = "hovering ellipse at Re 75, 10 particles per chord: means and histories of lift and drag"
    slow: bool = False
    cells: int = 10
    cycles: int = 3
    side: float = 8.0
    reynolds: float = 75.0
    amplitude: float = 2.8
    thickness: float = 0.1
    remark: str = (
        "the drag is 8 % too high, and a single run scatters by 1.7 %: seven starts disturbed otherwise gave "
        "+4.8 to +9.7 %, +8.2 +- 0.6 % in the mean (lift -6.0 to +0.8 %); with the sums in their former "
        "order (decisions/0020) and the same starts +5.0 to +9.5 %, +7.7 +- 0.6 %; on a processor with "
        "32-byte vectors six gave +6.9 to +11.7 %, +9.6 +- 0.7 %"
    )

    def run(self) -> list[Check]:
        """Run the case and compare."""
        time, lift, drag, history = self.histories()
        checks = []
        reference = _digitised()
        last = (reference[:, 0] >= self.cycles - 1) & (reference[:, 0] <= self.cycles - 0.01)
        cycle = reference[last, 0]
        for column, label, found, scale in ((1, "lift", lift, 1.2), (2, "drag", drag, 1.4)):
            exact = scale * reference[last, column]
            own = np.array([found[np.abs(time - t) < 0.02].mean() for t in cycle])
            mean, exact_mean = (float(np.trapezoid(q, cycle) / np.ptp(cycle)) for q in (own, exact))
            checks.append(
                Check(
                    self.name,
                    f"mean {label} coefficient of cycle {self.cycles}",
                    mean,
                    exact_mean,
                    exact_mean,
                    10.0,
                    _SOURCE,
                )
            )
            correlation = float(np.corrcoef(own, exact)[0, 1])
            checks.append(
                Check(
                    self.name, f"correlation of the history of {label}", correlation, 1.0, 1.0, 10.0, _SOURCE
                )
            )
        return [*checks, history.balance(self.name, 1e-2)]

    def histories(self) -> tuple[FloatArray, FloatArray, FloatArray, History]:
        """Return cycles, lift and drag coefficients at every step, and the history."""
        dp, omega = 1.0 / self.cells, 2.0 / self.amplitude
        period = 2.0 * math.pi / omega
        flow = plane_flow(
            dp,
            self.side,
            self.side,
            upstream=0.5 * self.side,
            viscosity=1.0 / self.reynolds,
            sound_speed=15.0,
            fringe=Fringe(width=1.0, rate=20.0, around=True),
            set_back=0.0,
            precision="single",
        )

        def pose(t: float) -> Pose:
            c, s = math.cos(omega * t), math.sin(omega * t)
            along = 0.5 * self.amplitude * np.array([1.0, 0.0])
            # The chord starts upright; it leans so that the leading edge is the upper one in both strokes.
            quarter = 0.25 * math.pi
            return Pose(
                c * along,
                -omega * s * along,
                -(omega**2) * c * along,
                2.0 * quarter + quarter * s,
                quarter * omega * c,
                -quarter * omega**2 * s,
            )

        half_chord, half_thickness = 0.5, 0.5 * self.thickness

        def inside(x: FloatArray) -> np.ndarray:
            # At time zero the chord lies along z at x = A0/2.
            along, across = x[:, 2], x[:, 0] - 0.5 * self.amplitude
            return np.asarray((along / half_chord) ** 2 + (across / half_thickness) ** 2 < 1.0)

        chains = [
            Chain(name, half_ellipse(1.0, self.thickness, sign, dp), pose)
            for name, sign in (("upper", 1.0), ("lower", -1.0))
        ]
        solver = Solver(flow, outlines(chains, dp, inside), 0.0, highest_speed=1.5)
        history = History(solver)
        history.until(self.cycles * period)
        time, force = history.forces()
        towards = -np.sign(np.sin(omega * time))
        return time / period, 2.0 * force[:, 1], -2.0 * force[:, 0] * towards, history


def _digitised() -> FloatArray:
    """Return cycle, lift and drag over their largest quasi-steady values, shape (n, 3)."""
    text = (files("cwmav_sim") / "data" / "hover_re75.csv").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    return np.loadtxt(rows[1:], delimiter=",")
