# SPDX-License-Identifier: Apache-2.0
"""Decaying array of vortices in a periodic square."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.verification.flows import History, plane_flow
from cwmav_sim.verification.protocol import Check

_SOURCE = "exact: G. I. Taylor, A. E. Green, Proc. R. Soc. A 158 (1937) 499"


@dataclass(frozen=True)
class TaylorGreen:
    """Side 1, highest speed 1, Reynolds number 100; u = -exp(bt) cos(2 pi x) sin(2 pi z), b = -8 pi^2/Re."""

    name: str = "taylor-green"
    summary: str = "decaying vortices at Re 100: rate of decay, velocity field"
    slow: bool = False
    cells: int = 50
    reynolds: float = 100.0
    duration: float = 1.0

    def run(self) -> list[Check]:
        """Run the case and compare."""
        rate, error, balance = self.measure()
        exact = -16.0 * math.pi**2 / self.reynolds
        return [
            Check(self.name, "decay rate of the energy [U/L]", rate, exact, exact, 3.0, _SOURCE),
            Check(self.name, "rms error of velocity at the end, over its rms", error, 0.0, 1.0, 5.0, _SOURCE),
            balance,
        ]

    def measure(self) -> tuple[float, float, Check]:
        """Return the decay rate, the relative rms error of the velocity at the end, and the balance."""
        flow = plane_flow(1.0 / self.cells, 1.0, 1.0, viscosity=1.0 / self.reynolds, sound_speed=10.0)
        solver = Solver(flow, None, 0.0, highest_speed=1.0)
        x, z = solver.position[:, 0], solver.position[:, 2]
        solver.velocity[:] = _velocity(x, z)
        # The pressure that belongs to this velocity field.
        solver.set_pressure(-0.25 * (np.cos(4 * math.pi * x) + np.cos(4 * math.pi * z)))
        history, begin = History(solver), solver.momentum()
        times, energies = [], []

        def watch(info: object) -> None:
            times.append(solver.time)
            energies.append(0.5 * float(np.sum(np.square(solver.velocity))))

        history.until(self.duration, watch)
        rate = float(np.polyfit(times, np.log(energies), 1)[0])
        exact = _velocity(solver.position[:, 0], solver.position[:, 2]) * math.exp(
            -8.0 * math.pi**2 / self.reynolds * solver.time
        )
        error = math.sqrt(float(np.sum((solver.velocity - exact) ** 2) / np.sum(exact**2)))
        balance = Check(
            self.name,
            "change of the momentum of the air [sum of m |v|]",
            float(np.linalg.norm(solver.momentum() - begin)),
            0.0,
            flow.resolution.dp**2 * float(np.linalg.norm(solver.velocity, axis=1).sum()),
            1e-4,
            "exact: nothing acts from outside",
        )
        return rate, error, balance


def _velocity(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    k = 2.0 * math.pi
    return np.column_stack([-np.cos(k * x) * np.sin(k * z), np.zeros_like(x), np.sin(k * x) * np.cos(k * z)])
