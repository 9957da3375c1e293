# SPDX-License-Identifier: Apache-2.0
"""Sheet nodes on their facets: motion node by node, load and carried inertia body by body.

What :mod:`cwmav_sim.wing.facets` describes. Loops run as :mod:`cwmav_sim.wing.arithmetic` says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.wing.algebra import across, compiled, matrix, plus, put, row, times, turned
from cwmav_sim.wing.sheet import FloatArray, IntArray

if TYPE_CHECKING:
    from cwmav_sim.wing.parts import Configuration


class Carriers(NamedTuple):
    """Which bodies carry which sheet nodes, by pairs.

    Attributes
    ----------
    nodes, bodies : ndarray, shape (q,)
        Sheet node and body of each pair.
    arm : ndarray, shape (q, 3)
        Place of the node in the body's material axes [m].
    share : ndarray, shape (q,)
        Share of the body in the node's motion.
    node_starts, node_pairs : ndarray, shape (n + 1,) and (q,)
        First of the pairs of every node, and the pairs node by node.
    body_starts, body_pairs : ndarray, shape (k + 1,) and (q,)
        The same of every body.
    """

    nodes: IntArray
    bodies: IntArray
    arm: FloatArray
    share: FloatArray
    node_starts: NDArray[np.int32]
    node_pairs: NDArray[np.int32]
    body_starts: NDArray[np.int32]
    body_pairs: NDArray[np.int32]


@compiled
def carried_motion(
    first: int,
    last: int,
    carriers: Carriers,
    c: Configuration,
    acceleration: FloatArray,
    places: FloatArray,
    speeds: FloatArray,
    rates: FloatArray,
) -> None:
    """Fill in place, velocity and acceleration of the sheet nodes, shape (n, 3) each."""
    bodies = len(c.x)
    for node in range(first, last):
        x = v = a = (0.0, 0.0, 0.0)
        for p in range(carriers.node_starts[node], carriers.node_starts[node + 1]):
            q = carriers.node_pairs[p]
            b, share = carriers.bodies[q], carriers.share[q]
            arm, w = turned(matrix(c.turn, b), row(carriers.arm, q)), row(c.spin, b)
            rim = across(w, arm)
            x = plus(x, times(share, plus(row(c.x, b), arm)))
            v = plus(v, times(share, plus(row(c.v, b), rim)))
            swing = plus(across(row(acceleration, bodies + b), arm), across(w, rim))
            a = plus(a, times(share, plus(row(acceleration, b), swing)))
        put(places, node, x)
        put(speeds, node, v)
        put(rates, node, a)


@compiled
def carried_load(
    first: int, last: int, carriers: Carriers, turn: FloatArray, forces: FloatArray, out: FloatArray
) -> None:
    """Fill in forces, then moments, on the bodies from forces on the sheet nodes, shape (2 bodies, 3)."""
    for b in range(first, last):
        force = moment = (0.0, 0.0, 0.0)
        for p in range(carriers.body_starts[b], carriers.body_starts[b + 1]):
            q = carriers.body_pairs[p]
            part = times(carriers.share[q], row(forces, carriers.nodes[q]))
            force = plus(force, part)
            moment = plus(moment, across(turned(matrix(turn, b), row(carriers.arm, q)), part))
        put(out, b, force)
        put(out, len(turn) + b, moment)


@compiled
def carried_inertia(
    first: int,
    last: int,
    carriers: Carriers,
    turn: FloatArray,
    mass: FloatArray,
    normal: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in the inertia along their normals that masses on the sheet nodes give bodies, (k, 6, 6)."""
    for b in range(first, last):
        for i in range(6):
            for j in range(6):
                out[b, i, j] = 0.0
        for p in range(carriers.body_starts[b], carriers.body_starts[b + 1]):
            q = carriers.body_pairs[p]
            node = carriers.nodes[q]
            n = row(normal, node)
            m = across(turned(matrix(turn, b), row(carriers.arm, q)), n)
            along = n[0], n[1], n[2], m[0], m[1], m[2]
            weight = carriers.share[q] * mass[node]
            for i in range(6):
                for j in range(6):
                    out[b, i, j] += weight * along[i] * along[j]
