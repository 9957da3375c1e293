# SPDX-License-Identifier: Apache-2.0
"""Still air stays still around resting wings, and does not push them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim import case as cases
from cwmav_sim.solver import Solver
from cwmav_sim.verification.protocol import Check

_TYPICAL_LIFT = 0.16  # N, the vehicle's weight
_SOURCE = "exact: air at rest exerts no force"


@dataclass(frozen=True)
class StillAir:
    """Resting wings of the smoke preset in air at rest.

    The lattice of particles is cut by the wings, so the air first settles; speed and force are those of the
    second half of the run.
    """

    name: str = "still-air"
    summary: str = "air at rest around resting wings: no speed, no force"
    slow: bool = False
    steps: int = 400

    def run(self) -> list[Check]:
        """Run the case and compare."""
        case = cases.with_overrides(
            cases.preset("smoke"), ["airspeed=0", "angle_of_attack_deg=0", "run.flapping=False"]
        )
        solver = Solver(case.flow, case.motion(), case.airspeed)
        lifts, speeds = [], []
        for _ in range(self.steps):
            info = solver.step()
            lifts.append(case.copies * float(info.pressure[:, 2].sum() + info.viscous[:, 2].sum()))
            speeds.append(float(np.sqrt(np.max(np.sum(np.square(solver.velocity), axis=1)))))
        late = slice(self.steps // 2, None)
        force = float(np.sqrt(np.mean(np.square(lifts[late]))))
        speed = max(speeds[late])
        sound = solver.sound_speed
        return [
            Check(self.name, "highest speed [m/s]", speed, 0.0, sound, 0.1, _SOURCE),
            Check(self.name, "rms force normal to the wind [N]", force, 0.0, _TYPICAL_LIFT, 1.0, _SOURCE),
        ]
