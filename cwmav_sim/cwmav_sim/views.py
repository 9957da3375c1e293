# SPDX-License-Identifier: Apache-2.0
"""What pictures, snapshots and topics see of a solver."""

from __future__ import annotations

from typing import Protocol

from cwmav_sim.sph.sheet import Nodes
from cwmav_sim.wing.sheet import FloatArray


class ParticleView(Protocol):
    """What a snapshot reads from a solver; arrays of n particles."""

    time: float

    @property
    def position(self) -> FloatArray:
        """Positions [m], shape (n, 3)."""
        ...

    @property
    def velocity(self) -> FloatArray:
        """Velocities [m/s], shape (n, 3)."""
        ...

    @property
    def density(self) -> FloatArray:
        """Densities [kg/m3], shape (n,)."""
        ...

    @property
    def pressure(self) -> FloatArray:
        """Pressures [Pa], shape (n,)."""
        ...

    @property
    def sheet(self) -> Nodes | None:
        """Nodes of the wings at this instant."""
        ...
