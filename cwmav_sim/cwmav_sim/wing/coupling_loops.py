# SPDX-License-Identifier: Apache-2.0
"""Nodes and rows one by one in the exchange of :mod:`cwmav_sim.coupling`.

Loops run as :mod:`cwmav_sim.wing.arithmetic` says.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cwmav_sim.wing.algebra import across, compiled, dot, minus, plus, put, row, times
from cwmav_sim.wing.motion_loops import rate_of
from cwmav_sim.wing.sheet import FloatArray, IntArray

if TYPE_CHECKING:
    from cwmav_sim.wing.parts import Configuration


@compiled
def foreseen_nodes(
    first: int,
    last: int,
    s: float,
    x: FloatArray,
    v: FloatArray,
    a: FloatArray,
    places: FloatArray,
    speeds: FloatArray,
) -> None:
    """Fill in places and velocities a time ``s`` [s] on, with a steady acceleration, shape (n, 3) each."""
    for i in range(first, last):
        rise = row(a, i)
        put(places, i, plus(plus(row(x, i), times(s, row(v, i))), times(0.5 * s * s, rise)))
        put(speeds, i, plus(row(v, i), times(s, rise)))


@compiled
def rate_changes(
    first: int, last: int, step: float, begin: Configuration, end: Configuration, out: FloatArray
) -> None:
    """Fill in the mean accelerations of all rows over a step [s], shape (n + k, 3)."""
    for i in range(first, last):
        put(out, i, times(1.0 / step, minus(rate_of(end, i), rate_of(begin, i))))


@compiled
def sums(first: int, last: int, share: float, one: FloatArray, other: FloatArray, out: FloatArray) -> None:
    """Fill in ``share * (one + other)``, shape (n,)."""
    for i in range(first, last):
        out[i] = share * (one[i] + other[i])


@compiled
def differences(
    first: int, last: int, share: float, one: FloatArray, other: FloatArray, out: FloatArray
) -> None:
    """Fill in ``share * (one - other)``, shape (n,)."""
    for i in range(first, last):
        out[i] = share * (one[i] - other[i])


@compiled
def node_normals(
    first: int,
    last: int,
    x: FloatArray,
    triangles: IntArray,
    starts: IntArray,
    corners: IntArray,
    normal: FloatArray,
    inverse: FloatArray,
) -> None:
    """Fill in the area-weighted unit normal of every node (n, 3), and one over the length of its sum (n,).

    The corners of node ``i``, counted through all triangles, are ``corners[starts[i] : starts[i + 1]]``.
    """
    for i in range(first, last):
        total = (0.0, 0.0, 0.0)
        for p in range(starts[i], starts[i + 1]):
            m = corners[p] // 3
            a, b, c = row(x, triangles[m, 0]), row(x, triangles[m, 1]), row(x, triangles[m, 2])
            total = plus(total, across(minus(b, a), minus(c, a)))
        inverse[i] = 1.0 / math.sqrt(dot(total, total))
        put(normal, i, times(inverse[i], total))
