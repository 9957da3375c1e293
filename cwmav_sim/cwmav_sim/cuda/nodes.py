# SPDX-License-Identifier: Apache-2.0
"""Nodes of the walls on the card: their state, from the host or from a structure there, normals and loads."""

from __future__ import annotations

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from cwmav_sim.cuda.launch import CardArray, Mail, empty, launch, upload
from cwmav_sim.sph.sheet import Nodes, SheetLoad
from cwmav_sim.wing.sparsity import gathering


class CardNodes:
    """Nodes of all walls.

    Parameters
    ----------
    triangles : ndarray, shape (t, 3)
        Node numbers of each triangle.
    corners, weights : ndarray, shape (3, m)
        Nodes around every wall element, and their shares in its place.
    count : int
        Number of nodes.

    Attributes
    ----------
    rows : array, shape (9, n)
        Position, velocity and acceleration.
    normal : array, shape (3, n)
        Half the sums of the area vectors of the triangles around a node, by twice their areas [m2].
    """

    def __init__(
        self,
        triangles: NDArray[np.int64],
        corners: NDArray[np.int64],
        weights: NDArray[np.float64],
        count: int,
    ) -> None:
        self._count = count
        first, corner = gathering(triangles.ravel(), count)
        self._around = [upload(v.astype(np.int32)) for v in (triangles.T, first, corner // 3)]
        first, corner = gathering(corners.T.ravel(), count)
        self._elements = [upload(v) for v in (first, corner // 3)]
        self._shares = upload(weights.T.ravel()[corner])
        self.rows, self.normal, self._mail = empty((9, count)), empty((3, count)), Mail()

    def take(self, nodes: Nodes) -> None:
        """Take a state of the nodes, whose arrays lie on the host or on the card, and find its normals."""
        x: object = nodes.x
        if isinstance(x, np.ndarray):
            self._mail.send(np.hstack([nodes.x, nodes.v, nodes.a]).T, self.rows)
        else:
            launch(_take, self._count, nodes.x, nodes.v, nodes.a, self.rows)
        launch(_normals, self._count, self.rows, *self._around, self.normal)

    def load(self, reaction: CardArray, load: SheetLoad) -> None:
        """Bring reactions (4, m) of the elements, by number, to the nodes of a load on the card."""
        launch(_load, self._count, reaction, *self._elements, self._shares, load.force, load.carried)


@cuda.jit(cache=True)
def _take(x, v, a, rows):
    i = cuda.grid(1)
    if i < rows.shape[1]:
        for q in range(3):
            rows[q, i] = x[i, q]
            rows[3 + q, i] = v[i, q]
            rows[6 + q, i] = a[i, q]


@cuda.jit(cache=True)
def _normals(nodes, triangles, first, incident, normal):
    """Sum the area vectors of the triangles around every node."""
    i = cuda.grid(1)
    if i >= normal.shape[1]:
        return
    sx = sy = sz = 0.0
    for q in range(first[i], first[i + 1]):
        t = incident[q]
        a, b, c = triangles[0, t], triangles[1, t], triangles[2, t]
        ax, ay, az = nodes[0, b] - nodes[0, a], nodes[1, b] - nodes[1, a], nodes[2, b] - nodes[2, a]
        bx, by, bz = nodes[0, c] - nodes[0, a], nodes[1, c] - nodes[1, a], nodes[2, c] - nodes[2, a]
        sx += 0.5 * (ay * bz - az * by)
        sy += 0.5 * (az * bx - ax * bz)
        sz += 0.5 * (ax * by - ay * bx)
    normal[0, i] = sx
    normal[1, i] = sy
    normal[2, i] = sz


@cuda.jit(cache=True)
def _load(reaction, first, element, share, force, carried):
    """Sum the shares of a node in the forces on its elements and in the air that they carry."""
    i = cuda.grid(1)
    if i >= carried.shape[0]:
        return
    fx = fy = fz = mass = 0.0
    for p in range(first[i], first[i + 1]):
        e, w = element[p], share[p]
        fx += w * reaction[0, e]
        fy += w * reaction[1, e]
        fz += w * reaction[2, e]
        mass += w * reaction[3, e]
    force[i, 0] = fx
    force[i, 1] = fy
    force[i, 2] = fz
    carried[i] = mass
