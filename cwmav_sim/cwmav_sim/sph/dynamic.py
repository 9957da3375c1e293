# SPDX-License-Identifier: Apache-2.0
"""Plain dynamic boundary: one layer of wall particles that take part in the sums like air, for comparison.

Wall particles stand one spacing apart on every panel, carry the mass of an air particle and move with the
sheet. Their density follows the air around them and never falls below that at rest,

    drho/dt = rho sum V_b (v - v_b) . grad W  over the air,    rho >= rho0,

so the wall pushes and never pulls; both faces share the one density, and pairs across the wall are summed
(A. J. C. Crespo et al., Comput. Mater. Contin. 5 (2007) 173, as used by J. M. Dominguez et al., Comput. Part.
Mech. 9 (2022) 867). Air that sees a wall gets no density diffusion unless asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from cwmav_common.errors import InputError
from cwmav_sim.sph.sheet import Motion, Nodes
from cwmav_sim.sph.state import FloatArray, IntArray, Particles

_AS_WIDE_AS_LONG = 1e-6  # relative difference of extents that counts as none


@dataclass
class DynamicWall:
    """Wall particles of all panels and their densities.

    Attributes
    ----------
    panel : ndarray, shape (n,)
        Panel of every wall particle.
    density : ndarray, shape (n,)
        Density at the begin of the step [kg/m3].
    middle : ndarray, shape (n,)
        Density at half the step [kg/m3].
    """

    panel: IntArray
    density: FloatArray
    middle: FloatArray
    _corners: IntArray
    _barycentric: FloatArray
    _rest: float
    _mass: float

    @classmethod
    def on(cls, motion: Motion, dp: float, rest: float, dimensions: int) -> DynamicWall:
        """Cover the panels of a motion, in its state at time zero, with particles ``dp`` [m] apart.

        Raises
        ------
        InputError
            When a panel is too small to hold one.
        """
        x = np.asarray(motion.state(0.0).x, dtype=np.float64)
        triangles, of = np.asarray(motion.triangles), np.asarray(motion.panel)
        parts = []
        for p, name in enumerate(motion.panel_names):
            mine = triangles[of == p]
            found = _cover(x, mine, dp, dimensions)
            if not len(found[0]):
                raise InputError(f"sheet: panel '{name}' holds no wall particle at a spacing of {dp:g} m")
            parts.append((np.full(len(found[0]), p), *found))
        panel, corners, barycentric = (np.concatenate(q) for q in zip(*parts, strict=True))
        density = np.full(len(panel), rest)
        return cls(panel, density, density.copy(), corners, barycentric, rest, rest * dp**dimensions)

    def weights(self, nodes: int) -> sp.csr_matrix:
        """Return the share of each of ``nodes`` nodes in the position of every wall particle."""
        row = np.repeat(np.arange(len(self.panel)), 3)
        shape = (len(self.panel), nodes)
        return sp.csr_matrix((self._barycentric.ravel(), (row, self._corners.ravel())), shape=shape)

    def placed(self, nodes: Nodes, middle: bool, dimensions: int) -> Particles:
        """Return the wall particles for a state of the sheet, with their densities there."""
        x, v = (
            np.einsum("ek,ekj->ej", self._barycentric, values[self._corners]) for values in (nodes.x, nodes.v)
        )
        if dimensions == 2:
            x[:, 1] = v[:, 1] = 0.0
        return Particles(
            x, v, self.middle if middle else self.density, self._mass, np.arange(len(self.panel))
        )

    def predict(self, rate: FloatArray, dt: float) -> None:
        """Bring the densities to half the step with their rates at its begin [kg/(m3 s)]."""
        self.middle = np.maximum(self.density + 0.5 * dt * rate, self._rest)

    def correct(self, rate: FloatArray, dt: float) -> None:
        """Bring the densities over the step with their rates at its middle."""
        e = -rate * dt / self.middle
        self.density = np.maximum(self.density * (2.0 - e) / (2.0 + e), self._rest)


def _cover(x: FloatArray, triangles: IntArray, dp: float, dimensions: int) -> tuple[IntArray, FloatArray]:
    """Place points ``dp`` apart on a panel; return corners and barycentric coordinates.

    The points are those of a square lattice in the mean plane of the panel, in two dimensions of a row along
    its chain.
    """
    if dimensions == 2:
        return _row(x, triangles, dp)
    used = x[np.unique(triangles)]
    centre = used.mean(axis=0)
    flat = (x - centre) @ _axes(used - centre).T
    low, high = flat[np.unique(triangles)].min(axis=0), flat[np.unique(triangles)].max(axis=0)
    counts = np.maximum(np.rint((high - low) / dp).astype(int), 1)
    start = 0.5 * (low + high) - 0.5 * (counts - 1) * dp
    lattice = start + dp * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 2)
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    corners, barycentric = [], []
    for point in lattice:
        weights = _barycentric(point, a, b, c)
        best = int(np.argmax(weights.min(axis=1)))
        if weights[best].min() >= -1e-9:
            corners.append(triangles[best])
            barycentric.append(weights[best])
    if not corners:
        return np.zeros((0, 3), np.int64), np.zeros((0, 3))
    return np.array(corners), np.array(barycentric)


def _axes(offsets: FloatArray) -> FloatArray:
    """Return two unit vectors in the mean plane of points, the longer extent first, shape (2, 3).

    Points as wide as long, such as a square, have no longer extent; whatever direction the decomposition then
    picks is chance, so the axis of coordinates nearest to the plane is taken.
    """
    extent, axes = np.linalg.svd(offsets, full_matrices=False)[1:]
    if extent[1] < (1.0 - _AS_WIDE_AS_LONG) * extent[0]:
        return np.asarray(axes[:2])
    normal = axes[2]
    first = np.eye(3)[np.argmin(np.abs(normal))]
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def _barycentric(point: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    e1, e2, r = b - a, c - a, point - a
    whole = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    second = (r[:, 0] * e2[:, 1] - r[:, 1] * e2[:, 0]) / whole
    third = (e1[:, 0] * r[:, 1] - e1[:, 1] * r[:, 0]) / whole
    return np.column_stack([1.0 - second - third, second, third])


def _row(x: FloatArray, triangles: IntArray, dp: float) -> tuple[IntArray, FloatArray]:
    kept: list[int] = []
    centre = x[triangles].mean(axis=1)[:, [0, 2]]
    for k, point in enumerate(centre):
        if not kept or np.linalg.norm(centre[kept] - point, axis=1).min() > 0.9 * dp:
            kept.append(k)
    return triangles[kept], np.full((len(kept), 3), 1.0 / 3.0)
