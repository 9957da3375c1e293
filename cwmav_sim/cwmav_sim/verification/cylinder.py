# SPDX-License-Identifier: Apache-2.0
"""A circular cylinder: started impulsively, and oscillating in line in air at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Fringe
from cwmav_sim.verification.flows import History, plane_flow, smoothed
from cwmav_sim.verification.outlines import Chain, Outlines, Pose, at_rest, circle, outlines
from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.sheet import FloatArray

_START = "P. Koumoutsakos, A. Leonard, J. Fluid Mech. 296 (1995) 1"
_SWING = "H. Dutsch et al., J. Fluid Mech. 360 (1998) 249"

# Time U t/R and drag coefficient.
_DRAG = {
    40: ((0.5, 2.57), (1.0, 2.17), (2.0, 2.03), (3.0, 1.96), (4.0, 1.91), (6.0, 1.82)),
    550: (
        (0.5, 0.739),
        (1.0, 0.741),
        (1.5, 0.909),
        (2.0, 1.113),
        (2.5, 1.249),
        (3.0, 1.287),
        (4.0, 1.207),
        (6.0, 1.063),
    ),
}


def _cylinder(radius: float, dp: float, pose: object) -> Outlines:
    return outlines(
        [Chain("cylinder", circle(radius, dp), pose)],  # type: ignore[arg-type]
        dp,
        lambda x: np.hypot(x[:, 0], x[:, 2]) < radius,
    )


@dataclass(frozen=True)
class StartedCylinder:
    """Radius 1 in a stream of speed 1 that begins at once; drag coefficient against time.

    The sound of the start leaves through zones around the box. Times before 0.5 R/U are not compared: there
    it is still under way. Sound travels at fifteen times the speed of the stream.

    Attributes
    ----------
    reynolds : int
        On the diameter, 40 or 550.
    cells : int
        Particles along the radius.
    length, height : float
        Box [R].
    """

    reynolds: int
    cells: int
    length: float = 20.0
    height: float = 20.0
    slow: bool = True
    remark: str = (
        "the drag rings with a period of 0.6 R/U, the time that sound takes for 9 R: its waves are three "
        "times as long as the zones around the box and come back from them, with a third of the drag at 1 "
        "R/U. Beneath it the rise of the drag from 1 to 3 R/U is hardly seen, with 10 as with 20 particles "
        "along the radius: at 1 R/U the boundary layer is 0.06 R thick, 1.2 spacings at 20."
    )

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"started-cylinder-re{self.reynolds}"

    @property
    def summary(self) -> str:
        """One line saying what is tested."""
        return f"drag of a cylinder started at once, Re {self.reynolds}, {self.cells} particles per radius"

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp, sound = 1.0 / self.cells, 15.0
        flow = plane_flow(
            dp,
            self.length,
            self.height,
            upstream=0.4 * self.length,
            viscosity=2.0 / self.reynolds,
            sound_speed=sound,
            fringe=Fringe(width=3.0, rate=25.0, around=True),
            precision="single",
        )
        solver = Solver(flow, _cylinder(1.0, dp, at_rest), 1.0, highest_speed=1.0)
        history = History(solver)
        table = np.array(_DRAG[self.reynolds])
        history.until(table[-1, 0] + 0.1)
        time, force = history.forces()
        drag = smoothed(time, force[:, 0], table[:, 0], 0.1)  # rho U^2 R = 1
        rms = float(np.sqrt(np.mean((drag / table[:, 1] - 1.0) ** 2)))
        checks = [Check(self.name, "rms of the relative error of drag", rms, 0.0, 1.0, 7.0, _START)]
        checks += [
            Check(
                self.name,
                f"drag coefficient at U t/R = {t:g}",
                float(found),
                float(exact),
                float(exact),
                14.0,
                _START,
            )
            for (t, exact), found in zip(table, drag, strict=True)
        ]
        return [*checks, history.balance(self.name, 1e-2)]


@dataclass(frozen=True)
class OscillatingCylinder:
    """Diameter 1, highest speed 1: Keulegan-Carpenter number 5, Re 100; Morison's coefficients."""

    name: str = "oscillating-cylinder"
    summary: str = (
        "cylinder oscillating in line at KC 5, Re 100: Morison coefficients, 20 particles per diameter"
    )
    slow: bool = True
    cells: int = 20
    keulegan_carpenter: float = 5.0
    reynolds: float = 100.0
    periods: int = 2
    side: float = 10.0
    remark: str = (
        "the drag lies at its bar: -6.6, -6.0 and -5.9 % from three starts (-5.5 % with the sums in a former "
        "order). The added mass is low whatever is changed. It is not resolution: 40 per diameter give "
        "drag and added mass -5.1 and -9.7 %; not the box: 16 diameters give -7.6 and "
        "-10.9 %; not the start: the fourth period gives -8.5 and -11.7 %. Nor body, wall or Stokes layer: "
        "at a KC number of 0.3 the added mass is 1.007 without viscosity (1.028 in theory) and 1.484 at the "
        "same Re / KC (1.505). What helps is a background pressure (1.5 rho U2: +0.2 and -5.7 %), so it is "
        "the suction of the wake; but that pressure adds drag elsewhere (hovering ellipse +12.7 instead of "
        "+7.1 %) and slows the cavities (decisions/0017)."
    )

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp, period = 1.0 / self.cells, self.keulegan_carpenter
        omega = 2.0 * math.pi / period
        flow = plane_flow(
            dp,
            self.side,
            self.side,
            upstream=0.5 * self.side,
            viscosity=1.0 / self.reynolds,
            sound_speed=15.0,
            fringe=Fringe(width=2.0, rate=5.0, around=True),  # the air far away is at rest
            precision="single",
        )

        def pose(t: float) -> Pose:
            along = np.array([1.0, 0.0])
            return Pose(
                (1.0 - math.cos(omega * t)) / omega * along,
                math.sin(omega * t) * along,
                omega * math.cos(omega * t) * along,
            )

        solver = Solver(flow, _cylinder(0.5, dp, pose), 0.0, highest_speed=1.0)
        history = History(solver)
        history.until(self.periods * period)
        time, force = history.forces()
        late = time > period
        drag, inertia = _morison(time[late], force[late, 0], omega)
        return [
            Check(self.name, "drag coefficient of Morison's equation", drag, 2.09, 2.09, 6.0, _SWING),
            Check(
                self.name, "added-mass coefficient of Morison's equation", inertia, 1.45, 1.45, 6.0, _SWING
            ),
            history.balance(self.name, 1e-2),
        ]


def _morison(time: FloatArray, force: FloatArray, omega: float) -> tuple[float, float]:
    """Fit F = -1/2 rho D cd |u| u - pi/4 rho D^2 ci du/dt to the force on a cylinder with u = sin(w t)."""
    u, a = np.sin(omega * time), omega * np.cos(omega * time)
    system = -np.column_stack([0.5 * np.abs(u) * u, 0.25 * math.pi * a])
    found = np.linalg.lstsq(system, force, rcond=None)[0]
    return float(found[0]), float(found[1])
