# SPDX-License-Identifier: Apache-2.0
"""A column of fluid at rest under gravity between floor and ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.verification.flows import OUTSIDE, History, plane_flow
from cwmav_sim.verification.outlines import Chain, line, outlines
from cwmav_sim.verification.protocol import Check

_SOURCE = "exact: p = rho g (depth)"


@dataclass(frozen=True)
class HydrostaticColumn:
    """Height 1, gravity 1, density 1; sides periodic; sound as in the paper's table 2."""

    name: str = "hydrostatic"
    summary: str = "column at rest under gravity: pressure, speed, weight on the floor"
    slow: bool = False
    cells: int = 30
    duration: float = 20.0

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp, sound = 1.0 / self.cells, 20.0
        length, height = 20 * dp, 1.0 + 2 * OUTSIDE * dp
        flow = plane_flow(
            dp, length, height, viscosity=1e-3, sound_speed=sound, gravity=1.0, set_back=0.0, jitter=0.0
        )
        walls = outlines(
            [
                Chain("floor", line((0.0, -0.5), (length, -0.5))),
                Chain("ceiling", line((0.0, 0.5), (length, 0.5))),
            ],
            dp,
            lambda x: np.abs(x[:, 2]) > 0.5,
        )
        solver = Solver(flow, walls, 0.0, highest_speed=0.0)
        solver.set_pressure(0.5 - solver.position[:, 2])  # none at the ceiling
        history = History(solver)
        speeds: list[float] = []
        history.until(self.duration, lambda _: speeds.append(float(np.abs(solver.velocity).max())))
        pressure, z = solver.pressure, solver.position[:, 2]
        exact = z.mean() - z
        error = float(np.sqrt(np.mean((pressure - pressure.mean() - exact) ** 2)))
        time, _ = history.forces()
        floor = history.forces(0)[1][time > 0.5 * self.duration, 1].mean()
        ceiling = history.forces(1)[1][time > 0.5 * self.duration, 1].mean()
        late = max(speeds[len(speeds) // 2 :])
        return [
            Check(self.name, "rms error of pressure over rho g H", error, 0.0, 1.0, 1.0, _SOURCE),
            Check(self.name, "highest speed [c0]", late / sound, 0.0, 1.0, 0.1, _SOURCE),
            Check(
                self.name,
                "force on floor and ceiling [weight]",
                float(-floor - ceiling) / length,
                1.0,
                1.0,
                1.0,
                _SOURCE,
            ),
            history.balance(self.name),
        ]
