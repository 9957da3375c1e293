# SPDX-License-Identifier: Apache-2.0
"""Film as constant-strain triangles in finite deformation: total Lagrangian, St Venant-Kirchhoff.

With the positions x_i of the three corners and the constant gradients G_i of their shape functions in the
flat reference plane,

    F = sum_i x_i (x) G_i  (3 x 2),   E = (F'F - I)/2,   S = D (E + a1 dE/dt),   f_i = A t F S G_i,

where D is the plane-stress (film) or plane-strain law and a1 the Rayleigh coefficient of the damping
proportional to stiffness. Strains and their rates are objective: a rigid motion stores and loses nothing.
Source: Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed. 2008, chapters 4, 9.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from cwmav_common.errors import InputError
from cwmav_sim.wing.arithmetic import HOST, Arithmetic, brought_tuple
from cwmav_sim.wing.film_loops import (
    Triangles,
    film_dissipation,
    film_energy,
    film_forces,
    film_strain,
    film_tangent,
)
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray


def plane_stress(modulus: float, poisson: float) -> FloatArray:
    """Return the law S = D E of an isotropic film in Voigt order (11, 22, 2 x 12) [Pa], shape (3, 3)."""
    scale = modulus / (1.0 - poisson**2)
    shear = 0.5 * (1.0 - poisson)
    return scale * np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, shear]])


class Membrane:
    """Triangles of one film.

    Parameters
    ----------
    reference : ndarray, shape (n, 2)
        Stress-free coordinates of every node in the plane of the film [m].
    triangles : ndarray, shape (m, 3)
        Node numbers.
    thickness : float
        Thickness [m].
    law : ndarray, shape (3, 3)
        Material law in Voigt order [Pa]; see :func:`plane_stress`.
    viscosity : float
        Rayleigh coefficient a1 [s].
    """

    def __init__(
        self,
        reference: FloatArray,
        triangles: IntArray,
        *,
        thickness: float,
        law: FloatArray,
        viscosity: float = 0.0,
    ) -> None:
        self._arithmetic: Arithmetic = HOST
        self.triangles, self.viscosity, self._law = triangles, viscosity, law
        gradients, self.areas = _gradients(reference, triangles)
        self._film = Triangles(
            triangles, np.ascontiguousarray(gradients), thickness * self.areas, law, float(viscosity)
        )
        self._dofs = (3 * triangles[:, :, None] + np.arange(3)).reshape(len(triangles), 9)

    def brought(self, arithmetic: Arithmetic) -> Membrane:
        """Return the same film with its arrays in the place of an arithmetic."""
        other = copy(self)
        other._arithmetic, other._film = arithmetic, brought_tuple(arithmetic, self._film)
        return other

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of each triangle, shape (m, 9), on the host."""
        return self._dofs

    def strain(self, c: Configuration) -> FloatArray:
        """Return Green-Lagrange strains (E11, E22, 2 E12), shape (m, 3)."""
        out = self._arithmetic.empty(len(self._dofs), 3)
        self._arithmetic.run(film_strain, len(self._dofs), c.x, self._film, out)
        return out

    def stress(self, c: Configuration) -> FloatArray:
        """Return elastic second Piola-Kirchhoff stresses (S11, S22, S12) [Pa], shape (m, 3), on the host."""
        return np.asarray(self._arithmetic.on_host(self.strain(c)) @ self._law)

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting nodal forces [N], shape (m, 9)."""
        out = self._arithmetic.empty(*self._dofs.shape)
        self._arithmetic.run(film_forces, len(self._dofs), c.x, c.v, self._film, out)
        return out

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the stiffness with its viscous part, shape (m, 9, 9)."""
        out = self._arithmetic.empty(*self._dofs.shape, self._dofs.shape[1])
        self._arithmetic.run(
            film_tangent, len(self._dofs), c.x, c.v, self._film, rate, stressed.x, stressed.v, out
        )
        return out

    def energy(self, c: Configuration) -> float:
        """Return the strain energy [J]."""
        out = self._arithmetic.empty(len(self._dofs))
        self._arithmetic.run(film_energy, len(self._dofs), c.x, self._film, out)
        return self._arithmetic.total(out)

    def dissipation(self, c: Configuration) -> float:
        """Return the viscous power [W]."""
        if not self.viscosity:
            return 0.0
        out = self._arithmetic.empty(len(self._dofs))
        self._arithmetic.run(film_dissipation, len(self._dofs), c.x, c.v, self._film, out)
        return self._arithmetic.total(out)


def lumped_mass(areas: FloatArray, triangles: IntArray, count: int, areal_density: float) -> FloatArray:
    """Return a third of each triangle's mass at each of its corners [kg], shape (count,)."""
    share = np.repeat(areas * areal_density / 3.0, 3)
    return np.asarray(np.bincount(triangles.ravel(), share, minlength=count), dtype=np.float64)


def _gradients(reference: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """Constant shape-function gradients (m, 3, 2) and areas (m,) of the reference triangles."""
    corner = reference[triangles]
    edge = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)  # opposite each corner
    double = (corner[:, 1, 0] - corner[:, 0, 0]) * (corner[:, 2, 1] - corner[:, 0, 1]) - (
        corner[:, 2, 0] - corner[:, 0, 0]
    ) * (corner[:, 1, 1] - corner[:, 0, 1])
    longest = np.max(np.sum(edge**2, axis=2), axis=1)
    if np.any(double <= 1e-6 * longest):
        worst = int(np.argmin(double / longest))
        raise InputError(
            f"film mesh: triangle {worst} has area {0.5 * double[worst]:.3g} m2; "
            "allowed: > 0, counter-clockwise"
        )
    gradient = np.stack([-edge[:, :, 1], edge[:, :, 0]], axis=2) / double[:, None, None]
    return gradient, 0.5 * double
