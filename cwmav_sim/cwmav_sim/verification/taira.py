# SPDX-License-Identifier: Apache-2.0
"""A flat plate of aspect ratio 2 in a stream at Re 100: the two-sided sheet in three dimensions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution
from cwmav_sim.verification.flows import History
from cwmav_sim.verification.plates import FixedPlate
from cwmav_sim.verification.protocol import Check

_SOURCE = "K. Taira et al., AIAA 2007-710 (tow tank), lift and drag at t = 13 c/U or steady"

# Angle of attack [deg]: lift and drag coefficient.
_COEFFICIENTS = {
    10: (0.38, 0.41),
    20: (0.68, 0.51),
    30: (0.76, 0.64),
    40: (0.74, 0.81),
    50: (0.69, 1.00),
    60: (0.59, 1.15),
}


@dataclass(frozen=True)
class LowAspectRatioPlate:
    """Chord 1, span 2, speed 1, half model.

    Attributes
    ----------
    angle_deg : int
        Angle of attack [deg].
    cells : int
        Particles along the chord.
    duration : float
        Time simulated [c/U]; coefficients are means over its last fifth.
    """

    angle_deg: int
    cells: int = 10
    duration: float = 8.0
    slow: bool = True
    remark: str = (
        "ten particles per chord; in the plane the lift at 30 deg is low by a length at the edges that "
        "shrinks with the spacing (decisions 0005, 0007). While elements next to the mirror were hidden from "
        "the air on one side by their own image, the lift at 20 deg was 18 % low, and with periodic faces "
        "across z, where it flies in the downwash of its images, 25 % (decisions 0010, 0011). Why the drag "
        "is high from 40 deg on is not known. Means over 1.6 chords of travel are themselves uncertain: at "
        "50 deg two starts gave a lift of 0.742 and 0.741 and a drag of 1.135 and 1.137, a former solver, "
        "whose first 200 steps agree with these within 1e-12 in double precision, 0.654 and 1.076."
    )

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"plate-ar2-{self.angle_deg}deg"

    @property
    def summary(self) -> str:
        """One line saying what is tested."""
        return f"plate of aspect ratio 2 at Re 100 and {self.angle_deg} deg, {self.cells} particles per chord"

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp = 1.0 / self.cells
        flow = FlowSettings(
            fluid=Fluid(density=1.0, viscosity=0.01, sound_speed=12.0, mach_limit=0.5),
            resolution=Resolution(dp=dp, cfl=0.4, jitter=0.1),
            box=Box(length=7.5, width=5.0, height=4.0, upstream=2.5, symmetric=True),
            fringe=Fringe(width=1.5, rate=4.0, around=True),
        )
        plate = FixedPlate(1.0, 2.0, dp / 2.0, math.radians(self.angle_deg), half=True)
        solver = Solver(flow, plate, 1.0, highest_speed=1.0)
        history = History(solver)
        history.until(self.duration)
        time, force = history.forces()
        late = time > 0.8 * self.duration
        # Half a plate of area 1 in a stream of dynamic pressure 1/2.
        drag, lift = (2.0 * force[late].mean(axis=0)).tolist()
        cl, cd = _COEFFICIENTS[self.angle_deg]
        return [
            Check(self.name, "lift coefficient", lift, cl, cl, 10.0, _SOURCE),
            Check(self.name, "drag coefficient", drag, cd, cd, 10.0, _SOURCE),
            replace(history.balance(self.name, 1e-2), quantity="momentum in x and z not accounted for [N s]"),
        ]
