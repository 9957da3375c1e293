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

import numpy as np

from cwmav_sim.wing.connector_loops import (
    connector_dissipation,
    connector_energy,
    connector_forces,
    connector_tangent,
)
from cwmav_sim.wing.connector_shape import Ends, Stiffness
from cwmav_sim.wing.dynamics import Configuration
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
        self.first, self.second, self.stiffness, self.viscosity = first, second, stiffness, viscosity
        bodies1, bodies2 = (nodes_total + end.body[:, None] for end in (first, second))
        rows = np.concatenate([first.nodes, bodies1, second.nodes, bodies2], axis=1)
        self._dofs = (3 * rows[:, :, None] + np.arange(3)).reshape(len(rows), -1)

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns: nodes of the first end, its body, nodes of the second end, its body."""
        return self._dofs

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting forces and moments, shape (m, d)."""
        forces = connector_forces(
            c.x, c.v, c.turn, c.spin, self.first, self.second, self.stiffness, self.viscosity
        )
        return forces.reshape(self._dofs.shape)

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the stiffness with its viscous part, shape (m, d, d).

        Derivatives of tau and S are left out: they are of second order in psi, below 1 % of the term they
        would correct at 0.3 rad per element, and only convergence depends on them.
        """
        tangent = connector_tangent(
            c.x,
            c.turn,
            self.first,
            self.second,
            self.stiffness,
            self.viscosity,
            rate,
            stressed.x,
            stressed.v,
            stressed.turn,
            stressed.spin,
        )
        return tangent.reshape(*self._dofs.shape, -1)

    def energy(self, c: Configuration) -> float:
        """Return the elastic energy [J]."""
        return connector_energy(c.x, c.turn, self.first, self.second, self.stiffness)

    def dissipation(self, c: Configuration) -> float:
        """Return the viscous power [W]."""
        if not self.viscosity:
            return 0.0
        return connector_dissipation(
            c.x, c.v, c.turn, c.spin, self.first, self.second, self.stiffness, self.viscosity
        )
