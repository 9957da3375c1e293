# SPDX-License-Identifier: Apache-2.0
"""Rigid facets of the quasi-flexible wing, and the sheet that hangs on them.

A panel's triangles are grouped into facets by span and chord. Each facet is one rigid body with the mass and
principal inertia of its film and rods. A sheet node between facets follows the mean of the points that they
carry there; its load is shared in the same way, so force, moment and work are conserved.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from cwmav_sim.wing.arithmetic import brought_tuple
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.facet_loops import Carriers, carried_inertia, carried_load, carried_motion
from cwmav_sim.wing.geometry import PanelMesh, WingPlanform
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.rotation import cross, skew, turn
from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState
from cwmav_sim.wing.sparsity import gathering


@dataclass(frozen=True)
class Facets:
    """Facets of one panel in hinge coordinates.

    Attributes
    ----------
    of_triangle : ndarray, shape (m,)
        Facet of every triangle.
    mass : ndarray, shape (f,)
        Masses [kg].
    centre : ndarray, shape (f, 3)
        Centres of mass [m].
    inertia : ndarray, shape (f, 3)
        Principal moments of inertia [kg m2].
    axes : ndarray, shape (f, 3, 3)
        Principal axes, columns.
    """

    of_triangle: IntArray
    mass: FloatArray
    centre: FloatArray
    inertia: FloatArray
    axes: FloatArray


def group_triangles(mesh: PanelMesh, planform: WingPlanform, spanwise: int, chordwise: int) -> IntArray:
    """Return the facet of every triangle, numbered without gaps, shape (m,)."""
    r, s = (field[mesh.triangles].mean(axis=1) for field in (mesh.r, mesh.s))
    along = (r - planform.root) / (planform.length - planform.root)
    across = s / np.maximum(planform.chord(r), 1e-12)
    row = np.clip((spanwise * along).astype(np.int64), 0, spanwise - 1)
    column = np.clip((chordwise * across).astype(np.int64), 0, chordwise - 1)
    _, number = np.unique(row * chordwise + column, return_inverse=True)
    return number.astype(np.int64)


def rigid_facets(of_triangle: IntArray, points: FloatArray, point_mass: FloatArray, at: IntArray) -> Facets:
    """Build facets from point masses.

    Parameters
    ----------
    of_triangle : ndarray, shape (m,)
        Facet of every triangle.
    points : ndarray, shape (q, 3)
        Places of the masses in hinge coordinates [m].
    point_mass : ndarray, shape (q,)
        Masses [kg].
    at : ndarray, shape (q,)
        Facet of each.
    """
    count = int(of_triangle.max()) + 1
    mass, moment = np.zeros(count), np.zeros((count, 3))
    np.add.at(mass, at, point_mass)
    np.add.at(moment, at, point_mass[:, None] * points)
    centre = moment / mass[:, None]
    arm = points - centre[at]
    square = np.einsum("qi,qi->q", arm, arm)[:, None, None] * np.eye(3) - arm[:, :, None] * arm[:, None, :]
    tensor = np.zeros((count, 3, 3))
    np.add.at(tensor, at, point_mass[:, None, None] * square)
    inertia, axes = np.linalg.eigh(tensor)
    axes[:, :, 2] = cross(axes[:, :, 0], axes[:, :, 1])  # right-handed
    return Facets(of_triangle, mass, centre, inertia, axes)


class FacetSheet:
    """Sheet nodes carried by facets; implements :class:`cwmav_sim.wing.sheet_map.SheetMap`.

    Parameters
    ----------
    nodes, bodies : ndarray, shape (q,)
        Each pair says that a body carries a sheet node.
    arm : ndarray, shape (q, 3)
        Place of the node in the body's material axes [m].
    """

    def __init__(self, system: System, nodes: IntArray, bodies: IntArray, arm: FloatArray) -> None:
        self._system, self._count = system, int(nodes.max()) + 1
        share = 1.0 / np.bincount(nodes, minlength=self._count)[nodes]
        by_node, by_body = gathering(nodes, self._count), gathering(bodies, system.bodies)
        self._carriers = Carriers(nodes, bodies, arm, share, *by_node, *by_body)

    def brought(self, system: System) -> FacetSheet:
        """Return the same sheet on the structure in another place."""
        other = copy(self)
        other._system = system
        other._carriers = brought_tuple(system.arithmetic, self._carriers)
        return other

    def state(self, c: Configuration, acceleration: FloatArray) -> SheetState:
        """Return the mean of what the facets carry."""
        arithmetic = self._system.arithmetic
        x, v, a = (arithmetic.empty(self._count, 3) for _ in range(3))
        arithmetic.run(carried_motion, self._count, self._carriers, c, acceleration, x, v, a)
        return SheetState(x, v, a)

    def load(self, c: Configuration, forces: FloatArray) -> FloatArray:
        """Return forces and moments on the bodies."""
        arithmetic, bodies = self._system.arithmetic, self._system.bodies
        out = arithmetic.empty(2 * bodies, 3)
        arithmetic.run(carried_load, bodies, self._carriers, c.turn, forces, out)
        return out

    def kick(self, c: Configuration, impulses: FloatArray) -> FloatArray:
        """Return the change of the bodies' velocities and spins."""
        change = self._system.solve_inertia(c, self.load(c, impulses))
        change[self._system.held_rows] = 0.0
        return change

    def compliance(self, c: Configuration) -> sp.csr_matrix:
        """Return the sheet's velocities per nodal impulse."""
        jacobian = self._jacobian(c)
        s = self._system
        free = np.ones(s.rows)
        free[s.held_rows] = 0.0
        linear = np.eye(3) / s.inertia.mass[:, None, None]
        angular = np.einsum("kij,kj,klj->kil", c.turn, 1.0 / s.inertia.rotary, c.turn)
        blocks = free[:, None, None] * np.concatenate([linear, angular])
        inverse = sp.bsr_matrix((blocks, np.arange(s.rows), np.arange(s.rows + 1)))
        return sp.csr_matrix(jacobian @ inverse @ jacobian.T)

    def carried(self, c: Configuration, mass: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the inertia of every body, shape (bodies, 6, 6); bodies share the nodes between them."""
        arithmetic, bodies = self._system.arithmetic, self._system.bodies
        out = arithmetic.empty(bodies, 6, 6)
        arithmetic.run(carried_inertia, bodies, self._carriers, c.turn, mass, normal, out)
        return out

    def _jacobian(self, c: Configuration) -> sp.csr_matrix:
        """Velocities of the sheet per rate of the bodies, shape (3 n, 3 (n + k))."""
        rows, carriers = self._system.rows, self._carriers
        arm = turn(c.turn[carriers.bodies], carriers.arm)
        blocks = np.concatenate([np.broadcast_to(np.eye(3), (len(arm), 3, 3)), -skew(arm)])
        blocks = np.tile(carriers.share, 2)[:, None, None] * blocks
        node = np.tile(carriers.nodes, 2)
        row = np.concatenate([carriers.bodies, self._system.nodes + carriers.bodies])
        axis = np.arange(3)
        i = np.broadcast_to(3 * node[:, None, None] + axis[:, None], blocks.shape)
        j = np.broadcast_to(3 * row[:, None, None] + axis, blocks.shape)
        return sp.csr_matrix((blocks.ravel(), (i.ravel(), j.ravel())), shape=(3 * self._count, 3 * rows))
