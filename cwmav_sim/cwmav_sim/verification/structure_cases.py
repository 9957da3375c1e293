# SPDX-License-Identifier: Apache-2.0
"""The verification cases of the wing structure alone."""

from __future__ import annotations

from cwmav_sim.verification.protocol import VerificationCase
from cwmav_sim.verification.structure_film import DrumFrequencies, FilmPatch
from cwmav_sim.verification.structure_flag import FlagAtRest, FlagSwinging
from cwmav_sim.verification.structure_models import LatticeAgainstMembrane
from cwmav_sim.verification.structure_rod import LargeDeflection, RodEnergy, RodFrequencies


def structure_cases() -> tuple[VerificationCase, ...]:
    """Return every case of the structure, all of them quick."""
    return (
        FilmPatch(),
        DrumFrequencies(),
        LargeDeflection(),
        RodFrequencies(),
        RodEnergy(),
        FlagAtRest(),
        FlagSwinging(),
        LatticeAgainstMembrane(),
    )
