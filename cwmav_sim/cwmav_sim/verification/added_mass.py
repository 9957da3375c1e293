# SPDX-License-Identifier: Apache-2.0
"""Added mass of a rectangular plate: the force of still air on a plate that accelerates normal to itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution
from cwmav_sim.verification.flows import History
from cwmav_sim.verification.plates import OscillatingPlate, added_mass_from
from cwmav_sim.verification.protocol import Check

_SOURCE = "potential flow: m = K (pi/4) rho a^2 b for a plate of sides a <= b (K of tabulated added masses)"


@dataclass(frozen=True)
class AddedMass:
    """Small oscillation of a plate normal to itself.

    Attributes
    ----------
    name : str
        Name on the command line.
    aspect_ratio : float
        Longer side over shorter side.
    coefficient : float
        K of the reference.
    chord : float
        Shorter side [m].
    cells : int
        Particles along the shorter side.
    """

    name: str
    aspect_ratio: float
    coefficient: float
    chord: float = 0.08
    cells: int = 20
    slow: bool = True
    remark: str = (
        "the flow round a free edge is cut off at a spacing, so a plate acts longer by 2 (1 - set-back) "
        "spacings, here 7.5 % of either side; a larger set-back mends that and spoils the lift of separated "
        "flow (decisions 0005, 0007)."
    )

    @property
    def summary(self) -> str:
        """One line saying what is tested."""
        return (
            f"added mass of a plate of aspect ratio {self.aspect_ratio:g}, {self.cells} particles per chord"
        )

    def run(self) -> list[Check]:
        """Run the case and compare."""
        flow = self._flow()
        frequency = flow.fluid.sound_speed / (40.0 * self.chord)
        plate = OscillatingPlate(
            chord=self.chord,
            span=self.chord * self.aspect_ratio,
            spacing=flow.resolution.dp,
            amplitude=0.002 * self.chord,
            frequency=frequency,
            half=True,
        )
        solver = Solver(flow, plate, 0.0)
        history = History(solver)
        history.until(0.5 / frequency)
        time, half = history.forces()
        forces = 2.0 * half[:, 1]
        late = time > 0.1 / frequency  # the acceleration starts at once, and its sound must leave first
        acceleration = np.array([plate.acceleration(t) for t in time[late]])
        speed = np.array([plate.speed(t) for t in time[late]])
        found = added_mass_from(forces[late], acceleration, speed)
        span = self.chord * self.aspect_ratio
        reference = self.coefficient * 0.25 * math.pi * flow.fluid.density * self.chord**2 * span
        return [
            Check(self.name, "added mass [kg]", found, reference, reference, 10.0, _SOURCE),
            history.balance(self.name, 1e-2),
        ]

    def _flow(self) -> FlowSettings:
        dp = self.chord / self.cells
        span = self.chord * self.aspect_ratio
        box = Box(
            length=4.0 * self.chord,
            width=span + 3.0 * self.chord,
            height=4.0 * self.chord,
            upstream=2.0 * self.chord,
            symmetric=True,
        )
        base = FlowSettings(resolution=Resolution(dp=dp, cfl=0.4), fluid=Fluid(viscosity=1.48e-5), box=box)
        return replace(base, fringe=Fringe(width=0.0))
