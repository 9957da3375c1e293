# SPDX-License-Identifier: Apache-2.0
"""All verification cases by name."""

from __future__ import annotations

from cwmav_common.errors import InputError
from cwmav_sim.verification.added_mass import AddedMass
from cwmav_sim.verification.balance import MomentumBalance
from cwmav_sim.verification.protocol import VerificationCase
from cwmav_sim.verification.still_air import StillAir
from cwmav_sim.verification.structure_cases import structure_cases


def catalogue() -> tuple[VerificationCase, ...]:
    """Return every case, quick ones first."""
    return (
        StillAir(),
        MomentumBalance(),
        AddedMass("added-mass-ar1", aspect_ratio=1.0, coefficient=0.579),
        AddedMass("added-mass-ar2", aspect_ratio=2.0, coefficient=0.757),
        *structure_cases(),
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
