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

import numba as nb
import numpy as np
import scipy.sparse as sp

from cwmav_common.errors import InputError
from cwmav_sim.sph.forces import (
    FLUID_SCALARS,
    FLUID_VECTORS,
    FOUR_NU,
    MASS,
    RHO0,
    SLOPE,
    _particle,
    _store,
)
from cwmav_sim.sph.gather import (
    ANY_IMAGE,
    FAR,
    MOST_RUNS,
    SLABS,
    aligned_rows,
    fill,
    stretch,
    stretches,
    window,
)
from cwmav_sim.sph.pair import FLUID_ROWS, HALF_OVER_H, VOLUME, sum_pairs
from cwmav_sim.sph.sheet import Motion, Nodes
from cwmav_sim.sph.state import FloatArray, IntArray, Particles
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode
from cwmav_sim.sph.visibility import CHUNKS


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
    axes = np.linalg.svd(used - centre, full_matrices=False)[2][:2]
    flat = (x - centre) @ axes.T
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


@nb.njit(cache=True, parallel=True, error_model="numpy")
def air_pass(
    fluid,
    column,
    order,
    start,
    wall,
    wall_column,
    wall_order,
    wall_start,
    integers,
    cell,
    k,
    scale,
    shifting,
    keep_diffusion,
    room,
    wall_room,
    acceleration,
    density_rate,
    shift,
):
    """Rates of change of the air among itself and the wall particles.

    Parameters
    ----------
    fluid, column, order, start : ndarray
        Packed air in cell order, columns, numbers, first places; likewise the wall particles.
    integers, cell, k, scale, shifting, acceleration, density_rate, shift
        As in :func:`cwmav_sim.sph.forces.fluid_pass`.
    keep_diffusion : bool
        False switches the density diffusion off for air that sees a wall particle.
    room, wall_room : int
        Lengths of the largest buffers.
    """
    ny, nx = integers[1], integers[0]
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        buf = aligned_rows(FLUID_ROWS, room, fluid)
        near = aligned_rows(FLUID_ROWS, wall_room, fluid)
        begin, wall_begin = np.empty(SLABS + 1, np.int64), np.empty(SLABS + 1, np.int64)
        runs = np.empty((MOST_RUNS, 6), np.int64)
        filler = np.zeros(FLUID_ROWS, fluid.dtype)
        filler[0] = FAR
        for number in range(chunk, stretches(integers), CHUNKS):
            place = stretch(integers, number)
            cx, cy, z0, z1, centre = place
            for points, columns, first_place, target, first_entry in (
                (fluid, column, start, buf, begin),
                (wall, wall_column, wall_start, near, wall_begin),
            ):
                fill(
                    points,
                    columns,
                    first_place,
                    integers,
                    cell,
                    place,
                    FLUID_VECTORS,
                    FLUID_SCALARS,
                    ANY_IMAGE,
                    filler,
                    runs,
                    target,
                    first_entry,
                )
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                first, n = window(begin, cz - z0)
                first_wall, n_wall = window(wall_begin, cz - z0)
                offset = cell.dtype.type(cz - centre) * cell[2]
                for i in range(start[c], start[c + 1]):
                    a, at = _particle(fluid, offset, i), order[i]
                    sums = _sums(a, buf, first, n, k, shifting)
                    sees = _sees(a, near, first_wall, n_wall, k[HALF_OVER_H])
                    keep = keep_diffusion or not sees
                    _store(sums, scale, a[6], keep, at, acceleration, density_rate, shift)
                    if sees:
                        sums = _sums(a, near, first_wall, n_wall, k, shifting)
                        _add(sums, scale, a[6], at, acceleration, density_rate, shift)
        restore_mode(mode)


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def _sums(a, buf, first, n, k, shifting):
    """Return the sums over all of a buffer; walls of particles hide nothing."""
    return sum_pairs(a, buf, buf[VOLUME], first, n, k, shifting)


@nb.njit(cache=True, error_model="numpy")
def _sees(a, buf, first, n, half_over_h):
    for j in range(first, first + n):
        dx, dy, dz = a[0] - buf[0, j], a[1] - buf[1, j], a[2] - buf[2, j]
        if (dx * dx + dy * dy + dz * dz) * half_over_h * half_over_h < 1.0:
            return True
    return False


@nb.njit(cache=True, error_model="numpy")
def _add(sums, scale, density, place, acceleration, density_rate, shift):
    rho = scale[RHO0] + density
    slope = scale[SLOPE]
    for q in range(3):
        acceleration[place, q] += slope * (-sums[2 + q] / rho + scale[FOUR_NU] * sums[5 + q])
        shift[place, q] += slope * sums[8 + q]
    density_rate[place] += slope * rho * sums[0]


@nb.njit(cache=True, parallel=True, error_model="numpy")
def wall_pass(
    fluid,
    column,
    order,
    start,
    wall,
    wall_column,
    wall_order,
    wall_start,
    integers,
    cell,
    k,
    scale,
    room,
    density_rate,
    force,
):
    """Density rates of the wall particles, and the force of the air on each of them.

    Parameters
    ----------
    fluid, column, order, start, wall, wall_column, wall_order, wall_start, integers, cell, k, scale, room
        As in :func:`air_pass`.
    density_rate : ndarray, shape (n,), float64
        Filled with rates [kg/(m3 s)], under the numbers of the wall particles.
    force : ndarray, shape (8, n), float64
        Filled likewise with pressure force, viscous force [N], and the power of each on the moving wall [W].
    """
    ny, nx = integers[1], integers[0]
    for chunk in nb.prange(CHUNKS):
        mode = flush_subnormals()
        buf = aligned_rows(FLUID_ROWS, room, fluid)
        begin = np.empty(SLABS + 1, np.int64)
        runs = np.empty((MOST_RUNS, 6), np.int64)
        filler = np.zeros(FLUID_ROWS, fluid.dtype)
        filler[0] = FAR
        for number in range(chunk, stretches(integers), CHUNKS):
            place = stretch(integers, number)
            cx, cy, z0, z1, centre = place
            empty = True
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                empty = empty and wall_start[c + 1] == wall_start[c]
            if empty:
                continue
            fill(
                fluid,
                column,
                start,
                integers,
                cell,
                place,
                FLUID_VECTORS,
                FLUID_SCALARS,
                ANY_IMAGE,
                filler,
                runs,
                buf,
                begin,
            )
            for cz in range(z0, z1):
                c = (cz * ny + cy) * nx + cx
                first, n = window(begin, cz - z0)
                offset = cell.dtype.type(cz - centre) * cell[2]
                for i in range(wall_start[c], wall_start[c + 1]):
                    a, at = _particle(wall, offset, i), wall_order[i]
                    sums = _sums(a, buf, first, n, k, False)
                    rho = scale[RHO0] + a[6]
                    density_rate[at] = scale[SLOPE] * rho * sums[0]
                    force[6, at] = force[7, at] = 0.0
                    for q in range(3):
                        force[q, at] = -scale[MASS] * scale[SLOPE] * sums[2 + q] / rho
                        force[3 + q, at] = scale[MASS] * scale[SLOPE] * scale[FOUR_NU] * sums[5 + q]
                        force[6, at] += force[q, at] * a[3 + q]
                        force[7, at] += force[3 + q, at] * a[3 + q]
        restore_mode(mode)
