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

# Columns of what a node touches: number of the triangle (-1 for none), barycentric shares of the touched
# point, unit normal, distance from the plane, negative when passed through [m].
TRIANGLE, SHARES, NORMAL, GAP = 0, slice(1, 4), slice(4, 7), 7
FOUND = 8


@compiled
def centres_of(first: int, last: int, x: FloatArray, triangles: IntArray, out: FloatArray) -> None:
    """Fill in the centres of triangles (m, 3) [m]."""
    for m in range(first, last):
        a, b, c = row(x, triangles[m, 0]), row(x, triangles[m, 1]), row(x, triangles[m, 2])
        put(out, m, times(1.0 / 3.0, plus(plus(a, b), c)))


@compiled
def nearest_squares(
    first: int, last: int, x: FloatArray, nodes: IntArray, centres: FloatArray, out: FloatArray
) -> None:
    """Fill in the squared distance of every node from the nearest centre [m2], shape (p,)."""
    for p in range(first, last):
        place, least = row(x, nodes[p]), math.inf
        for m in range(len(centres)):
            apart = minus(place, row(centres, m))
            least = min(least, dot(apart, apart))
        out[p] = least


@compiled
def touched(
    first: int,
    last: int,
    x: FloatArray,
    nodes: IntArray,
    triangles: IntArray,
    centres: FloatArray,
    sign: float,
    distance: float,
    reach: float,
    found: FloatArray,
) -> None:
    """Fill in what every node touches: of the triangles whose prism holds it, the nearest.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Places [m].
    nodes, triangles : ndarray, shapes (p,) and (m, 3)
        Nodes of one wing, triangles of the other.
    centres : ndarray, shape (m, 3)
        Centres of the triangles [m].
    sign : float
        Turns the triangles' normals towards the nodes.
    distance, reach : float
        Distances from a triangle's plane and from its centre up to which a node counts [m].
    found : ndarray, shape (p, 8)
        Receives what is touched.
    """
    for p in range(first, last):
        place = row(x, nodes[p])
        found[p, 0] = -1.0
        for m in range(len(triangles)):
            apart = minus(place, row(centres, m))
            if dot(apart, apart) > reach * reach:
                continue
            a, b, c = row(x, triangles[m, 0]), row(x, triangles[m, 1]), row(x, triangles[m, 2])
            area = across(minus(b, a), minus(c, a))
            normal = times(sign / math.sqrt(dot(area, area)), area)
            gap = dot(normal, minus(place, a))
            if gap >= distance or (found[p, 0] >= 0.0 and abs(gap) >= abs(found[p, 7])):
                continue
            foot = minus(place, times(gap, normal))
            share = _share(foot, b, c, area), _share(foot, c, a, area), _share(foot, a, b, area)
            if min(share) > _OUTSIDE:
                found[p, 0], found[p, 7] = m, gap
                for k in range(3):
                    found[p, 1 + k], found[p, 4 + k] = share[k], normal[k]


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
