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

import numpy as np

from cwmav_common.errors import InputError
from cwmav_sim.wing.dynamics import Configuration
from cwmav_sim.wing.kernels import film_forces
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
        self.triangles, self.viscosity = triangles, viscosity
        gradients, self.areas = _gradients(reference, triangles)
        self._gradients = np.ascontiguousarray(gradients)
        self._law = law
        self._volume = thickness * self.areas
        self._dofs = (3 * triangles[:, :, None] + np.arange(3)).reshape(len(triangles), 9)

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of each triangle, shape (m, 9)."""
        return self._dofs

    def strain(self, c: Configuration) -> FloatArray:
        """Return Green-Lagrange strains (E11, E22, 2 E12), shape (m, 3)."""
        return _strain(self._deformation(c.x))

    def stress(self, c: Configuration) -> FloatArray:
        """Return elastic second Piola-Kirchhoff stresses (S11, S22, S12) [Pa], shape (m, 3)."""
        return np.asarray(self.strain(c) @ self._law)

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting nodal forces [N], shape (m, 9)."""
        forces: FloatArray = film_forces(
            c.x, c.v, self.triangles, self._gradients, self._volume, self._law, self.viscosity
        )
        return forces

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the stiffness with its viscous part, shape (m, 9, 9)."""
        b = self._variation(self._deformation(c.x))
        response = (1.0 + self.viscosity * rate) * b
        if self.viscosity:
            response = response + self.viscosity * self._variation(self._deformation(c.v))
        stress = self._volume[:, None] * (self._total_strain(stressed) @ self._law)
        material = np.swapaxes(b, 1, 2) @ (self._volume[:, None, None] * (self._law @ response))
        tensor = np.stack([stress[:, [0, 2]], stress[:, [2, 1]]], axis=1)
        geometric = self._gradients @ tensor @ np.swapaxes(self._gradients, 1, 2)
        out = material.reshape(-1, 3, 3, 3, 3)
        for axis in range(3):
            out[:, :, axis, :, axis] += geometric
        return np.asarray(out.reshape(-1, 9, 9))

    def energy(self, c: Configuration) -> float:
        """Return the strain energy [J]."""
        strain = self.strain(c)
        return 0.5 * float(np.sum(self._volume[:, None] * strain * (strain @ self._law)))

    def dissipation(self, c: Configuration) -> float:
        """Return the viscous power [W]."""
        if not self.viscosity:
            return 0.0
        rate = _strain_rate(self._deformation(c.x), self._deformation(c.v))
        return self.viscosity * float(np.sum(self._volume[:, None] * rate * (rate @ self._law)))

    def _total_strain(self, c: Configuration) -> FloatArray:
        """Strain plus a1 times its rate."""
        f = self._deformation(c.x)
        if not self.viscosity:
            return _strain(f)
        return np.asarray(_strain(f) + self.viscosity * _strain_rate(f, self._deformation(c.v)))

    def _deformation(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.swapaxes(x[self.triangles], 1, 2) @ self._gradients)

    def _variation(self, f: FloatArray) -> FloatArray:
        """Return the derivative of the strain to the corner positions, shape (m, 3, 9)."""
        g = self._gradients
        first, second = f[:, None, :, 0], f[:, None, :, 1]
        out = np.empty((len(f), 3, 3, 3))
        out[:, 0] = g[:, :, :1] * first
        out[:, 1] = g[:, :, 1:] * second
        out[:, 2] = g[:, :, :1] * second + g[:, :, 1:] * first
        return out.reshape(-1, 3, 9)


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


def _strain(f: FloatArray) -> FloatArray:
    first, second = f[:, :, 0], f[:, :, 1]
    return np.stack(
        [
            0.5 * (np.einsum("mi,mi->m", first, first) - 1.0),
            0.5 * (np.einsum("mi,mi->m", second, second) - 1.0),
            np.einsum("mi,mi->m", first, second),
        ],
        axis=1,
    )


def _strain_rate(f: FloatArray, flow: FloatArray) -> FloatArray:
    first, second = f[:, :, 0], f[:, :, 1]
    return np.stack(
        [
            np.einsum("mi,mi->m", first, flow[:, :, 0]),
            np.einsum("mi,mi->m", second, flow[:, :, 1]),
            np.einsum("mi,mi->m", first, flow[:, :, 1]) + np.einsum("mi,mi->m", second, flow[:, :, 0]),
        ],
        axis=1,
    )
