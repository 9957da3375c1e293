# SPDX-License-Identifier: Apache-2.0
"""Sheet nodes on their facets one by one: motion, load and carried inertia.

What :mod:`cwmav_sim.wing.facets` describes, pair by pair of a node and a body that carries it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cwmav_sim.wing.algebra import across, compiled, matrix, plus, put_sum, row, times, turned
from cwmav_sim.wing.sheet import FloatArray, IntArray


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
    """

    nodes: IntArray
    bodies: IntArray
    arm: FloatArray
    share: FloatArray


@compiled
def carried_motion(
    carriers: Carriers,
    count: int,
    x: FloatArray,
    v: FloatArray,
    turn: FloatArray,
    spin: FloatArray,
    acceleration: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return place, velocity and acceleration of ``count`` sheet nodes, shape (count, 3) each."""
    places, speeds, rates = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    for q in range(len(carriers.nodes)):
        b, node, share = carriers.bodies[q], carriers.nodes[q], carriers.share[q]
        arm, w = turned(matrix(turn, b), row(carriers.arm, q)), row(spin, b)
        rim = across(w, arm)
        put_sum(places, node, times(share, plus(row(x, b), arm)))
        put_sum(speeds, node, times(share, plus(row(v, b), rim)))
        swing = plus(across(row(acceleration, len(x) + b), arm), across(w, rim))
        put_sum(rates, node, times(share, plus(row(acceleration, b), swing)))
    return places, speeds, rates


@compiled
def carried_load(carriers: Carriers, turn: FloatArray, forces: FloatArray, bodies: int) -> FloatArray:
    """Return forces, then moments, on the bodies from forces on the sheet nodes, shape (2 bodies, 3)."""
    out = np.zeros((2 * bodies, 3))
    for q in range(len(carriers.nodes)):
        b = carriers.bodies[q]
        force = times(carriers.share[q], row(forces, carriers.nodes[q]))
        put_sum(out, b, force)
        put_sum(out, bodies + b, across(turned(matrix(turn, b), row(carriers.arm, q)), force))
    return out


@compiled
def carried_inertia(carriers: Carriers, turn: FloatArray, mass: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the inertia along their normals that masses on the sheet nodes give each body, (k, 6, 6)."""
    out, along = np.zeros((len(turn), 6, 6)), np.empty(6)
    for q in range(len(carriers.nodes)):
        b, node = carriers.bodies[q], carriers.nodes[q]
        n = row(normal, node)
        moment = across(turned(matrix(turn, b), row(carriers.arm, q)), n)
        for i in range(3):
            along[i], along[3 + i] = n[i], moment[i]
        weight = carriers.share[q] * mass[node]
        for i in range(6):
            for j in range(6):
                out[b, i, j] += weight * along[i] * along[j]
    return out
