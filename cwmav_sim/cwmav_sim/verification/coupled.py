# SPDX-License-Identifier: Apache-2.0
"""Flexible wings in the air: the energy that the exchange makes, and what the time integration loses."""

from __future__ import annotations

from dataclasses import dataclass

from cwmav_common.errors import WorkError
from cwmav_sim import case as cases
from cwmav_sim.coupling import CoupledWings
from cwmav_sim.solver import Solver
from cwmav_sim.verification.protocol import Check

_SOURCE = "conservation of energy: what the air does on the wings is what the wings do not do on the air"


@dataclass(frozen=True)
class EnergyOfExchange:
    """The first cycle of flexible wings with the preset ``smoke``.

    The bars bound the two ways in which energy can come from nowhere: the staggered exchange, over the
    work of the wings on the air, and the integration of the structure, over the work of the drive.
    """

    model: str
    slow: bool = True
    flexible: bool = True
    cycles: float = 1.0

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"coupled-{self.model}"

    @property
    def summary(self) -> str:
        """What is tested."""
        return f"energy made by the exchange between air and flexible wings ({self.model})"

    def run(self) -> list[Check]:
        """Run the case and compare."""
        case = cases.with_overrides(cases.preset("smoke"), [f"wing.model={self.model}"])
        wings = case.motion()
        if not isinstance(wings, CoupledWings):
            raise WorkError(f"{self.name}: the model '{self.model}' is not moved by the air")
        solver = Solver(case.flow, wings, case.airspeed, highest_speed=case.highest_speed())
        work = 0.0
        while solver.time * case.flapping_frequency < self.cycles:
            info = solver.step()
            work += info.dt * float(info.power.sum())
        e = wings.energies
        return [
            Check(
                self.name,
                "work of the air on the wings plus that of the wings on the air [J]",
                e.load_work + work,
                0.0,
                work,
                5.0,
                _SOURCE,
            ),
            Check(
                self.name,
                "energy lost by the integration of the structure [J]",
                e.numerical,
                0.0,
                e.drive_work,
                1.0,
                _SOURCE,
            ),
        ]
