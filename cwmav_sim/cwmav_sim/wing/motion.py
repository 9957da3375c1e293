# SPDX-License-Identifier: Apache-2.0
"""What a moving structure is at one instant, and its energy account."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray


@dataclass(frozen=True)
class Energies:
    """Energy account since the start [J].

    Attributes
    ----------
    kinetic, elastic : float
        Energy of motion and of strain now.
    dissipated, contact : float
        Lost to damping, and in contacts.
    load_work, drive_work : float
        Work done by the external loads, and by the driven root.
    initial : float
        Kinetic and elastic energy at the start.
    """

    kinetic: float
    elastic: float
    dissipated: float
    contact: float
    load_work: float
    drive_work: float
    initial: float

    @property
    def numerical(self) -> float:
        """Energy that the time integration has lost (positive) or made (negative) [J]."""
        stored = self.kinetic + self.elastic - self.initial
        return self.load_work + self.drive_work - stored - self.dissipated - self.contact


@dataclass(frozen=True)
class Motion:
    """Everything a structure needs to go on from one instant; arrays only, so it can be stored."""

    time: float
    configuration: Configuration
    acceleration: FloatArray  # true, (n + k, 3)
    auxiliary: FloatArray  # the averaged acceleration a of the method
    force: FloatArray  # external, at this instant
    reaction: FloatArray  # on the driven rows
    energies: Energies

    def moved(self, bring: Callable[[FloatArray], FloatArray]) -> Motion:
        """Return the same motion with its arrays in another place."""
        return replace(
            self,
            configuration=Configuration(*(bring(field) for field in self.configuration)),
            acceleration=bring(self.acceleration),
            auxiliary=bring(self.auxiliary),
            force=bring(self.force),
            reaction=bring(self.reaction),
        )


FIELDS = ("acceleration", "auxiliary", "force", "reaction")


@dataclass
class Counters:
    """Work done by the integrator."""

    steps: int = 0
    iterations: int = 0
    factorisations: int = 0
    halvings: int = 0
