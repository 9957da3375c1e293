# SPDX-License-Identifier: Apache-2.0
"""Nodes against triangles one by one, and the impulses of all contacts together.

The laws are in :mod:`cwmav_sim.wing.contact`.
"""

from __future__ import annotations

import math

import numpy as np

from cwmav_sim.wing.algebra import Vector, across, compiled, dot, minus, plus, put, row, times
from cwmav_sim.wing.sheet import FloatArray, IntArray

_OUTSIDE = -1e-9  # least barycentric share of a foot that counts as on its triangle


@compiled
def centres_of(x: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the centres of triangles (m, 3) [m]."""
    out = np.empty((len(triangles), 3))
    for m in range(len(triangles)):
        a, b, c = row(x, triangles[m, 0]), row(x, triangles[m, 1]), row(x, triangles[m, 2])
        put(out, m, times(1.0 / 3.0, plus(plus(a, b), c)))
    return out


@compiled
def least_distance(x: FloatArray, nodes: IntArray, centres: FloatArray) -> float:
    """Return the least distance of nodes from centres [m]."""
    least = math.inf
    for i in nodes:
        for m in range(len(centres)):
            apart = minus(row(x, i), row(centres, m))
            least = min(least, dot(apart, apart))
    return math.sqrt(least)


@compiled
def touched(
    x: FloatArray, nodes: IntArray, triangles: IntArray, sign: float, distance: float, reach: float
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return what every node touches: of the triangles whose prism holds it, the nearest.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Places [m].
    nodes, triangles : ndarray, shapes (p,) and (m, 3)
        Nodes of one wing, triangles of the other.
    sign : float
        Turns the triangles' normals towards the nodes.
    distance, reach : float
        Distances from a triangle's plane and from its centre up to which a node counts [m].

    Returns
    -------
    triangle : ndarray, shape (p,)
        Number of the triangle, -1 for none.
    shares, normal : ndarray, shape (p, 3)
        Barycentric shares of the touched point, unit normal.
    gap : ndarray, shape (p,)
        Distance from the plane, negative when passed through [m].
    """
    centres = centres_of(x, triangles)
    triangle = np.full(len(nodes), -1, np.int64)
    shares, normals, gaps = np.empty((len(nodes), 3)), np.empty((len(nodes), 3)), np.empty(len(nodes))
    for p in range(len(nodes)):
        place = row(x, nodes[p])
        for m in range(len(triangles)):
            apart = minus(place, row(centres, m))
            if dot(apart, apart) > reach * reach:
                continue
            a, b, c = row(x, triangles[m, 0]), row(x, triangles[m, 1]), row(x, triangles[m, 2])
            area = across(minus(b, a), minus(c, a))
            normal = times(sign / math.sqrt(dot(area, area)), area)
            gap = dot(normal, minus(place, a))
            if gap >= distance or (triangle[p] >= 0 and abs(gap) >= abs(gaps[p])):
                continue
            foot = minus(place, times(gap, normal))
            share = _share(foot, b, c, area), _share(foot, c, a, area), _share(foot, a, b, area)
            if min(share) > _OUTSIDE:
                triangle[p], gaps[p] = m, gap
                put(shares, p, share)
                put(normals, p, normal)
    return triangle, shares, normals, gaps


@compiled
def _share(foot: Vector, one: Vector, two: Vector, area: Vector) -> float:
    """Barycentric share at ``foot`` of the corner that is neither ``one`` nor ``two``."""
    return dot(area, across(minus(one, foot), minus(two, foot))) / dot(area, area)


@compiled
def gauss_seidel(
    compliance: FloatArray, speed: FloatArray, target: FloatArray, friction: float, sweeps: int
) -> FloatArray:
    """Impulses (m, 3) in contact axes that bring the relative speeds (m, 3) to what the laws allow."""
    m = len(speed)
    u = speed.copy()
    impulse = np.zeros((m, 3))
    scale = np.max(np.abs(speed)) + np.max(target) + 1e-30
    for _ in range(sweeps):
        largest = 0.0
        for i in range(m):
            old = impulse[i].copy()
            diagonal = compliance[3 * i, 3 * i]
            if diagonal <= 0.0:
                continue
            impulse[i, 0] = max(0.0, old[0] - (u[i, 0] - target[i]) / diagonal)
            slide = compliance[3 * i + 1, 3 * i + 1] + compliance[3 * i + 2, 3 * i + 2]
            impulse[i, 1] = old[1] - 2.0 * u[i, 1] / slide
            impulse[i, 2] = old[2] - 2.0 * u[i, 2] / slide
            limit = friction * impulse[i, 0]
            size = np.sqrt(impulse[i, 1] ** 2 + impulse[i, 2] ** 2)
            if size > limit:
                impulse[i, 1] *= limit / size
                impulse[i, 2] *= limit / size
            for axis in range(3):
                change = impulse[i, axis] - old[axis]
                if change != 0.0:
                    largest = max(largest, abs(change) * diagonal)
                    for j in range(m):
                        for k in range(3):
                            u[j, k] += compliance[3 * j + k, 3 * i + axis] * change
        if largest <= 1e-6 * scale:
            break
    return impulse
