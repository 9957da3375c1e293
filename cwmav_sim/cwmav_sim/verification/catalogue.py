# SPDX-License-Identifier: Apache-2.0
"""All verification cases by name."""

from __future__ import annotations

from cwmav_common.errors import InputError
from cwmav_sim.verification.added_mass import AddedMass
from cwmav_sim.verification.balance import MomentumBalance
from cwmav_sim.verification.cavity import LidDrivenCavity
from cwmav_sim.verification.channel import Couette, Poiseuille
from cwmav_sim.verification.clap_fling import ClapAndFling
from cwmav_sim.verification.convergence import Convergence
from cwmav_sim.verification.coupled import EnergyOfExchange
from cwmav_sim.verification.cylinder import OscillatingCylinder, StartedCylinder
from cwmav_sim.verification.flag_in_flow import FlagInFlow
from cwmav_sim.verification.hover import HoveringEllipse
from cwmav_sim.verification.hydrostatic import HydrostaticColumn
from cwmav_sim.verification.plate import PlateAddedMass
from cwmav_sim.verification.protocol import VerificationCase
from cwmav_sim.verification.still_air import StillAir
from cwmav_sim.verification.structure_cases import structure_cases
from cwmav_sim.verification.taira import LowAspectRatioPlate
from cwmav_sim.verification.taylor_green import TaylorGreen


def catalogue() -> tuple[VerificationCase, ...]:
    """Return every case, quick ones first."""
    return (
        StillAir(),
        MomentumBalance(),
        HydrostaticColumn(),
        TaylorGreen(),
        Couette(),
        Poiseuille(),
        PlateAddedMass(),
        AddedMass("added-mass-ar1", aspect_ratio=1.0, coefficient=0.579),
        AddedMass("added-mass-ar2", aspect_ratio=2.0, coefficient=0.757),
        *structure_cases(),
        Convergence(),
        LidDrivenCavity(100, 3.0, 12.0),
        LidDrivenCavity(400, 4.0, 30.0),
        LidDrivenCavity(1000, 5.0, 45.0),
        StartedCylinder(40, 10),
        StartedCylinder(550, 20, length=16.0, height=16.0),
        OscillatingCylinder(),
        HoveringEllipse(),
        EnergyOfExchange("membrane"),
        EnergyOfExchange("lattice"),
        FlagInFlow(),
        *(ClapAndFling(reynolds) for reynolds in (8, 32, 128)),
        *(LowAspectRatioPlate(angle) for angle in (20, 30, 40, 50, 10, 60)),
    )


def select(name: str | None, everything: bool) -> tuple[VerificationCase, ...]:
    """Return one case by name, all cases, or the quick ones.

    Raises
    ------
    InputError
        For a name that is no case.
    """
    entries = catalogue()
    if name is None:
        return tuple(c for c in entries if everything or not c.slow)
    chosen = tuple(c for c in entries if c.name == name)
    if not chosen:
        known = ", ".join(c.name for c in entries)
        raise InputError(f"verification case '{name}' is unknown; allowed: {known}")
    return chosen
