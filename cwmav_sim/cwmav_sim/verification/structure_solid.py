# SPDX-License-Identifier: Apache-2.0
"""Nine-node quadrilaterals in plane strain: the solid the Turek-Hron structure benchmarks ask for.

A wing needs no solid. This element exists so that the benchmark of the flag runs through the same
assembly, static solver and time integrator as the wing. Total Lagrangian, St Venant-Kirchhoff, 3 x 3 Gauss
points, mass lumped by Simpson's rule on the nodes. Source: Bonet & Wood 2008, chapter 9.
"""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray

_GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)]), np.array([5.0, 8.0, 5.0]) / 9.0
_SIMPSON = np.array([-1.0, 0.0, 1.0]), np.array([1.0, 4.0, 1.0]) / 3.0


def plane_strain(modulus: float, poisson: float) -> FloatArray:
    """Return the law S = D E of plane strain in Voigt order (11, 22, 2 x 12) [Pa], shape (3, 3)."""
    lame = modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    shear = modulus / (2.0 * (1.0 + poisson))
    direct = lame + 2.0 * shear
    return np.array([[direct, lame, 0.0], [lame, direct, 0.0], [0.0, 0.0, shear]])


class Solid:
    """Quadrilaterals in the x-y plane, of unit thickness; z is no unknown of theirs.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Stress-free nodes [m].
    cells : ndarray, shape (m, 9)
        Node numbers of each cell, rows of three from bottom to top.
    law : ndarray, shape (3, 3)
        Material law in Voigt order [Pa].
    """

    def __init__(self, x: FloatArray, cells: IntArray, law: FloatArray) -> None:
        self.cells, self._law = cells, law
        self._gradients, self._volume = _at_points(x[cells][:, :, :2], *_GAUSS)
        self._dofs = (3 * cells[:, :, None] + np.arange(2)).reshape(len(cells), 18)

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of each cell, shape (m, 18)."""
        return self._dofs

    def forces(self, c: Configuration) -> FloatArray:
        """Return the nodal forces per unit thickness [N/m], shape (m, 18)."""
        f = self._deformation(c)
        stress = _tensor(_strain(f) @ self._law) * self._volume[..., None, None]
        return np.asarray(
            np.einsum("mgij,mgjk,mgak->mai", f, stress, self._gradients, optimize=True).reshape(-1, 18)
        )

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the stiffness, shape (m, 18, 18)."""
        f = self._deformation(c)
        g = self._gradients
        b = np.empty((*g.shape[:2], 3, 9, 2))
        b[:, :, 0] = g[..., :1] * f[:, :, None, :, 0]
        b[:, :, 1] = g[..., 1:] * f[:, :, None, :, 1]
        b[:, :, 2] = g[..., :1] * f[:, :, None, :, 1] + g[..., 1:] * f[:, :, None, :, 0]
        b = b.reshape(*g.shape[:2], 3, 18)
        out = np.einsum("mgur,uv,mgvs,mg->mrs", b, self._law, b, self._volume, optimize=True)
        stress = _tensor(_strain(self._deformation(stressed)) @ self._law) * self._volume[..., None, None]
        geometric = np.einsum("mgaj,mgjk,mgbk->mab", g, stress, g, optimize=True)
        blocks = out.reshape(-1, 9, 2, 9, 2)
        blocks[:, :, 0, :, 0] += geometric
        blocks[:, :, 1, :, 1] += geometric
        return np.asarray(blocks.reshape(-1, 18, 18))

    def energy(self, c: Configuration) -> float:
        """Return the strain energy per unit thickness [J/m]."""
        strain = _strain(self._deformation(c))
        return 0.5 * float(np.sum(self._volume[..., None] * strain * (strain @ self._law)))

    def dissipation(self, c: Configuration) -> float:
        """Return no viscous power: the benchmark is undamped."""
        return 0.0

    def _deformation(self, c: Configuration) -> FloatArray:
        corner = c.x[self.cells][:, :, :2]
        return np.asarray(np.einsum("mai,mgaj->mgij", corner, self._gradients, optimize=True))


def solid_mass(x: FloatArray, cells: IntArray, density: float) -> FloatArray:
    """Return the nodal masses per unit thickness [kg/m], shape (n,)."""
    _, volume = _at_points(x[cells][:, :, :2], *_SIMPSON)
    # at Simpson's points the shape functions are 1 at one node each: row sums become diagonal
    return np.asarray(np.bincount(cells.ravel(), density * volume.ravel(), minlength=len(x)))


def _at_points(corner: FloatArray, points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape-function gradients (m, g, 9, 2) and volumes (m, g) at a product rule."""
    one, slope = _lagrange(points)
    along = np.einsum("ga,hb->hgba", slope, one).reshape(len(points) ** 2, 9)
    across = np.einsum("ga,hb->hgba", one, slope).reshape(len(points) ** 2, 9)
    local = np.stack([along, across], axis=2)
    jacobian = np.einsum("mai,gaj->mgij", corner, local)
    gradients = np.einsum("gaj,mgji->mgai", local, np.linalg.inv(jacobian))
    return gradients, np.linalg.det(jacobian) * np.outer(weights, weights).ravel()


def _lagrange(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Quadratic Lagrange polynomials on -1, 0, 1 and their slopes at ``points``, shapes (g, 3)."""
    p = points
    values = np.stack([0.5 * p * (p - 1.0), 1.0 - p**2, 0.5 * p * (p + 1.0)], axis=1)
    return values, np.stack([p - 0.5, -2.0 * p, p + 0.5], axis=1)


def _strain(f: FloatArray) -> FloatArray:
    product = np.swapaxes(f, -1, -2) @ f
    return np.stack(
        [0.5 * (product[..., 0, 0] - 1.0), 0.5 * (product[..., 1, 1] - 1.0), product[..., 0, 1]], axis=-1
    )


def _tensor(voigt: FloatArray) -> FloatArray:
    out = np.empty((*voigt.shape[:-1], 2, 2))
    out[..., 0, 0], out[..., 1, 1] = voigt[..., 0], voigt[..., 1]
    out[..., 0, 1] = out[..., 1, 0] = voigt[..., 2]
    return out
