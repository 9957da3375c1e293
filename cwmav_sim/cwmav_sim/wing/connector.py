# SPDX-License-Identifier: Apache-2.0
"""Elastic connection of two turning bodies: one element of a carbon rod, or one joint of the lattice.

Two triads R1, R2 sit at attachment points that hang on arms from the bodies. With the rotation vector psi of
R1'R2 and the triad Rm = R1 exp(psi/2) half way between them, the element strains are

    e = Rm'(x2 - x1) - d0,     psi,       energy = sum(k_t e^2)/2 + sum(k_r psi^2)/2.

Both are unchanged by rigid motions. With k_t = (EA, GA, GA)/L and k_r = (GJ, EI2, EI3)/L this is the
geometrically exact (Simo-Reissner) rod with one-point quadrature, free of shear locking; with arms and other
constants it is a ball joint with linear springs. Forces are the exact gradient of the energy:

    n = Rm k_t e,  h = n x d,  p = Rm psi,  d(wm) = (dw1 + dw2)/2 - tau p x (dw2 - dw1)/2,
    tau = tan(psi/4)/psi,      d(psi) = S Rm'(dw2 - dw1),   S = a I + (1 - a) nn',  a = (psi/2)/sin(psi/2).

Sources: Simo & Vu-Quoc, CMAME 58 (1986) 79; Crisfield & Jelenic, Proc. R. Soc. A 455 (1999) 1125, on
objectivity.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from cwmav_sim.wing.arithmetic import HOST, Arithmetic, brought_tuple
from cwmav_sim.wing.connector_loops import (
    connector_dissipation,
    connector_energy,
    connector_forces,
    connector_tangent,
)
from cwmav_sim.wing.connector_shape import Ends, Stiffness
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray

__all__ = ["Connectors", "Ends", "Stiffness"]


class Connectors:
    """A family of connectors; see the module for the equations.

    Parameters
    ----------
    first, second : Ends
        The two ends.
    stiffness : Stiffness
        Elastic constants.
    nodes_total : int
        Number of position rows, after which the bodies' rows follow.
    viscosity : float
        Rayleigh coefficient a1 [s].
    """

    def __init__(
        self, first: Ends, second: Ends, stiffness: Stiffness, nodes_total: int, *, viscosity: float = 0.0
    ) -> None:
        self._arithmetic: Arithmetic = HOST
        self.first, self.second, self.stiffness, self.viscosity = first, second, stiffness, viscosity
        bodies1, bodies2 = (nodes_total + end.body[:, None] for end in (first, second))
        rows = np.concatenate([first.nodes, bodies1, second.nodes, bodies2], axis=1)
        self._dofs = (3 * rows[:, :, None] + np.arange(3)).reshape(len(rows), -1)

    def brought(self, arithmetic: Arithmetic) -> Connectors:
        """Return the same connectors with their arrays in the place of an arithmetic."""
        other = copy(self)
        other._arithmetic = arithmetic
        other.first, other.second = (brought_tuple(arithmetic, e) for e in (self.first, self.second))
        other.stiffness = brought_tuple(arithmetic, self.stiffness)
        return other

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns: nodes and body of the first end, nodes and body of the second; on the host."""
        return self._dofs

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting forces and moments of every row of a connector, shape (m, d/3, 3)."""
        count, size = self._dofs.shape
        out = self._arithmetic.empty(count, size // 3, 3)
        self._arithmetic.run(
            connector_forces,
            count,
            *c,
            self.first,
            self.second,
            self.stiffness,
            self.viscosity,
            out,
        )
        return out

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the stiffness with its viscous part, shape (m, d/3, 3, d/3, 3).

        Derivatives of tau and S are left out: they are of second order in psi, below 1 % of the term they
        would correct at 0.3 rad per element, and only convergence depends on them.
        """
        count, size = self._dofs.shape
        out = self._arithmetic.empty(count, size // 3, 3, size // 3, 3)
        self._arithmetic.run(
            connector_tangent,
            count,
            c.x,
            c.turn,
            self.first,
            self.second,
            self.stiffness,
            self.viscosity,
            rate,
            *stressed,
            out,
        )
        return out

    def energy(self, c: Configuration) -> float:
        """Return the elastic energy [J]."""
        out = self._arithmetic.empty(len(self._dofs))
        self._arithmetic.run(
            connector_energy, len(self._dofs), c.x, c.turn, self.first, self.second, self.stiffness, out
        )
        return self._arithmetic.total(out)

    def dissipation(self, c: Configuration) -> float:
        """Return the viscous power [W]."""
        if not self.viscosity:
            return 0.0
        out = self._arithmetic.empty(len(self._dofs))
        self._arithmetic.run(
            connector_dissipation,
            len(self._dofs),
            *c,
            self.first,
            self.second,
            self.stiffness,
            self.viscosity,
            out,
        )
        return self._arithmetic.total(out)
