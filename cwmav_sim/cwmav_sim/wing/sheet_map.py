# SPDX-License-Identifier: Apache-2.0
"""How the nodes of a sheet hang on the unknowns of a structure."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.load_loops import node_inertia, rows_of, sheet_rows
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, SheetState


class SheetMap(Protocol):
    """How the sheet's nodes hang on the unknowns of a structure; forces go the transposed way."""

    def state(self, c: Configuration, acceleration: FloatArray) -> SheetState:
        """Return the sheet of a configuration."""
        ...

    def load(self, c: Configuration, forces: FloatArray) -> FloatArray:
        """Return the forces and moments on the structure's rows that do the work of the nodal ``forces``."""
        ...

    def carried(self, c: Configuration, mass: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the inertia that nodal masses (n,) moving along ``normal`` (n, 3) add to each unknown.

        Blocks of the rows that :class:`cwmav_sim.wing.carried.CarriedAir` was given, shape (m, d, d), lumped:
        what couples different blocks is added to their diagonals.
        """
        ...


@runtime_checkable
class PortableMap(SheetMap, Protocol):
    """A sheet whose structure can be brought to another place."""

    def brought(self, system: System) -> PortableMap:
        """Return the same sheet on the structure there."""
        ...


@runtime_checkable
class ImpactMap(SheetMap, Protocol):
    """A sheet that can touch another one."""

    def kick(self, c: Configuration, impulses: FloatArray) -> FloatArray:
        """Return the change of all rates by nodal ``impulses`` (n, 3) [N s]; driven rows do not change."""
        ...

    def compliance(self, c: Configuration) -> sp.csr_matrix:
        """Return the change of the sheet's velocities per nodal impulse, shape (3 n, 3 n) [1/kg]."""
        ...


class NodesAreSheet:
    """The sheet's nodes are the structure's own."""

    def __init__(self, system: System) -> None:
        self._system = system

    def brought(self, system: System) -> NodesAreSheet:
        """Return the same sheet on the structure in another place."""
        return NodesAreSheet(system)

    def state(self, c: Configuration, acceleration: FloatArray) -> SheetState:
        """Return the nodes themselves."""
        arithmetic, n = self._system.arithmetic, self._system.nodes
        x, v, a = (arithmetic.empty(n, 3) for _ in range(3))
        for field, out in ((c.x, x), (c.v, v), (acceleration, a)):
            arithmetic.run(rows_of, n, field, out)
        return SheetState(x, v, a)

    def load(self, c: Configuration, forces: FloatArray) -> FloatArray:
        """Return the nodal forces, without moments on the bodies."""
        out = self._system.arithmetic.empty(self._system.rows, 3)
        self._system.arithmetic.run(sheet_rows, self._system.rows, forces, out)
        return out

    def kick(self, c: Configuration, impulses: FloatArray) -> FloatArray:
        """Return the change of the nodes' velocities, shape (n + k, 3)."""
        change = self._system.solve_inertia(c, self.load(c, impulses))
        change[self._system.held_rows] = 0.0
        return change

    def compliance(self, c: Configuration) -> sp.csr_matrix:
        """Return the inverse masses, zero for driven nodes."""
        inverse = 1.0 / self._system.inertia.mass
        inverse[self._system.drive.nodes] = 0.0
        return sp.diags(np.repeat(inverse, 3), format="csr")

    def carried(self, c: Configuration, mass: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the mass along the normal of every node, shape (n, 3, 3)."""
        arithmetic, n = self._system.arithmetic, self._system.nodes
        out = arithmetic.empty(n, 3, 3)
        arithmetic.run(node_inertia, n, mass, normal, out)
        return out
