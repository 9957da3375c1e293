# SPDX-License-Identifier: Apache-2.0
"""A flat plate without thickness in the plane: added mass, and drag after a start at Re 100."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.verification.flows import History, plane_flow
from cwmav_sim.verification.outlines import Chain, Pose, line, outlines
from cwmav_sim.verification.plates import added_mass_from
from cwmav_sim.verification.protocol import Check


@dataclass(frozen=True)
class PlateAddedMass:
    """Chord 1; a small oscillation normal to the plate in air at rest."""

    name: str = "added-mass-2d"
    summary: str = "added mass of a plane plate, 40 particles per chord"
    slow: bool = True
    cells: int = 40
    set_back: float = 0.25
    jitter: float = 0.1
    chords: float = 8.0
    remark: str = (
        "the flow round a free edge is cut off at a spacing, so a plate acts longer by 2 (1 - set-back) "
        "spacings (decisions 0005, 0007)."
    )

    def run(self) -> list[Check]:
        """Run the case and compare."""
        found, history = self.measure()
        return [
            Check(
                self.name,
                "added mass [pi/4 rho c^2]",
                found,
                1.0,
                1.0,
                10.0,
                "potential flow: pi/4 rho c^2 per span (H. Lamb, Hydrodynamics)",
            ),
            history.balance(self.name),
        ]

    def measure(self) -> tuple[float, History]:
        """Return the added mass over that of potential flow, and the history."""
        dp, period, amplitude = 1.0 / self.cells, 4.0, 0.002
        omega = 2.0 * math.pi / period

        def pose(t: float) -> Pose:
            up = np.array([0.0, 1.0])
            return Pose(
                amplitude * (1.0 - math.cos(omega * t)) * up,
                amplitude * omega * math.sin(omega * t) * up,
                amplitude * omega**2 * math.cos(omega * t) * up,
            )

        flow = plane_flow(
            dp,
            self.chords,
            self.chords,
            upstream=0.5 * self.chords,
            viscosity=1e-5,
            sound_speed=15.0,
            set_back=self.set_back,
            jitter=self.jitter,
        )
        plate = outlines([Chain("plate", line((-0.5, 0.0), (0.5, 0.0)), pose)], dp)
        solver = Solver(flow, plate, 0.0, highest_speed=amplitude * omega)
        history = History(solver)
        history.until(period)
        time, force = history.forces()
        late = time > 0.25 * period
        acceleration = np.array([pose(t).acceleration[1] for t in time[late]])
        speed = np.array([pose(t).speed[1] for t in time[late]])
        return added_mass_from(force[late, 1], acceleration, speed) / (0.25 * math.pi), history
