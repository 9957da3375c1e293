# SPDX-License-Identifier: Apache-2.0
"""The momentum given to the air equals the impulse of the force on the wings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cwmav_sim import case as cases
from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Fringe
from cwmav_sim.verification.protocol import Check

_SOURCE = "exact: Newton's third law"


@dataclass(frozen=True)
class MomentumBalance:
    """Flapping wings in a closed periodic box without fringe, pairs in double precision."""

    name: str = "momentum-balance"
    summary: str = "momentum of the air against the impulse on flapping wings, double precision"
    slow: bool = False
    steps: int = 60

    def run(self) -> list[Check]:
        """Run the case and compare."""
        case = cases.with_overrides(
            cases.preset("smoke").at(30.0, 15.0, 2.0), ["flow.resolution.precision=double"]
        )
        flow = replace(case.flow, fringe=Fringe(width=0.0))
        solver = Solver(flow, case.motion(), case.airspeed)
        start = solver.momentum()
        impulse = np.zeros(3)
        size = 0.0
        for _ in range(self.steps):
            before = solver.time
            info = solver.step()
            force = (info.pressure + info.viscous).sum(axis=0)
            impulse += (info.time - before) * force
            size += (info.time - before) * float(np.linalg.norm(force))
        gained = solver.momentum() - start
        # The plane of symmetry pushes sideways; along x and z nothing but the wings acts.
        return [
            Check(
                self.name,
                f"momentum of the air along {axis} plus impulse on the wings [N s]",
                float(gained[k] + impulse[k]),
                0.0,
                size,
                1e-4,
                _SOURCE,
            )
            for k, axis in ((0, "x"), (2, "z"))
        ]
