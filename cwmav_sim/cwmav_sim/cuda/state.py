# SPDX-License-Identifier: Apache-2.0
"""The particles on the card."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim.cuda.launch import CardArray, empty, upload
from cwmav_sim.sph.state import Particles


@dataclass
class CardParticles:
    """State of n particles, one row per component so that neighbouring threads read neighbouring numbers.

    Attributes
    ----------
    x, v : array, shape (3, n)
        Position [m] and velocity [m/s].
    rho : array, shape (n,)
        Density [kg/m3].
    identity : array, shape (n,), int64
        Number of each particle.
    """

    x: CardArray
    v: CardArray
    rho: CardArray
    identity: CardArray

    @classmethod
    def of(cls, particles: Particles) -> CardParticles:
        """Bring particles to the card."""
        return cls(
            upload(particles.x.T),
            upload(particles.v.T),
            upload(particles.rho),
            upload(particles.identity.astype(np.int64)),
        )

    @classmethod
    def room(cls, count: int) -> CardParticles:
        """Return room for so many particles."""
        return cls(empty((3, count)), empty((3, count)), empty(count), empty(count, np.int64))
