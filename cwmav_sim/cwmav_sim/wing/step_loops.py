# SPDX-License-Identifier: Apache-2.0
"""Nodes and bodies one by one through a step of :mod:`cwmav_sim.wing.integrate`, and its account of energy.

Fields of vectors have the rows of :mod:`cwmav_sim.wing.dynamics`: n positions, then k turns. Loops run as
:mod:`cwmav_sim.wing.arithmetic` says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cwmav_sim.wing.algebra import (
    Vector,
    compiled,
    dot,
    inlined,
    joined,
    matrix,
    minus,
    plus,
    product,
    put,
    put_matrix,
    rotation_by,
    row,
    straightened,
    times,
    transposed,
    turned,
    vector_of,
)
from cwmav_sim.wing.motion_loops import rate_of
from cwmav_sim.wing.sheet import FloatArray, IntArray

if TYPE_CHECKING:
    from cwmav_sim.wing.drive import Driven
    from cwmav_sim.wing.parts import Configuration


class Averages(NamedTuple):
    """Constants of generalised-alpha: shares of the begin in acceleration and forces, and Newmark's two."""

    am: float
    af: float
    beta: float
    gamma: float


@inlined
def _put_rate(c: Configuration, i: int, rate: Vector) -> None:
    if i < len(c.v):
        put(c.v, i, rate)
    else:
        put(c.spin, i - len(c.v), rate)


@inlined
def _place(begin: Configuration, c: Configuration, i: int, moved: Vector) -> None:
    """Put a row of ``c`` where the displacement or rotation vector of the step takes it."""
    n = len(c.x)
    if i < n:
        put(c.x, i, plus(row(begin.x, i), moved))
    else:
        put_matrix(c.turn, i - n, product(rotation_by(moved), matrix(begin.turn, i - n)))


@compiled
def predicted(
    first: int,
    last: int,
    h: float,
    averages: Averages,
    begin: Configuration,
    begin_acceleration: FloatArray,
    begin_auxiliary: FloatArray,
    swing: FloatArray,
    group: IntArray,
    c: Configuration,
    acceleration: FloatArray,
    moved: FloatArray,
) -> None:
    """Guess the end of a step of ``h`` [s]: everything travels rigidly with the ``swing`` of its carrier.

    Fills in the configuration, its true acceleration, and the displacement of the step (n + k, 3).
    """
    am, af, beta, gamma = averages
    for i in range(first, last):
        r = matrix(swing, group[i])
        way = minus(turned(r, row(begin.x, i)), row(begin.x, i)) if i < len(c.x) else vector_of(r)
        put(moved, i, way)
        before, old, rate = row(begin_auxiliary, i), row(begin_acceleration, i), rate_of(begin, i)
        auxiliary = minus(times(1.0 / (h * h), minus(way, times(h, rate))), times(0.5 - beta, before))
        auxiliary = times(1.0 / beta, auxiliary)
        averaged = plus(times(1.0 - gamma, before), times(gamma, auxiliary))
        _put_rate(c, i, plus(rate, times(h, averaged)))
        total = minus(plus(times(1.0 - am, auxiliary), times(am, before)), times(af, old))
        put(acceleration, i, times(1.0 / (1.0 - af), total))
        _place(begin, c, i, way)


@compiled
def corrected(
    first: int,
    last: int,
    rows: IntArray,
    solution: FloatArray,
    rate: float,
    ratio: float,
    begin: Configuration,
    c: Configuration,
    acceleration: FloatArray,
    moved: FloatArray,
) -> None:
    """Take a solution (f, 3) of Newton off the displacements of the free rows, and what follows from them.

    Displacements add up; rotation vectors compound. Velocities change by ``rate`` times what is added,
    accelerations by ``ratio`` times that.
    """
    for f in range(first, last):
        i, change = rows[f], times(-1.0, row(solution, f))
        before = row(moved, i)
        if i >= len(c.x):
            change = minus(joined(before, change), before)
        way = plus(before, change)
        put(moved, i, way)
        _put_rate(c, i, plus(rate_of(c, i), times(rate, change)))
        put(acceleration, i, plus(row(acceleration, i), times(ratio, change)))
        _place(begin, c, i, way)


@compiled
def held(first: int, last: int, nodes: IntArray, bodies: IntArray, driven: Driven, c: Configuration) -> None:
    """Put driven nodes and bodies where they are driven to."""
    for h in range(first, last):
        if h < len(nodes):
            put(c.x, nodes[h], row(driven.x, h))
            put(c.v, nodes[h], row(driven.v, h))
        else:
            b = h - len(nodes)
            put_matrix(c.turn, bodies[b], matrix(driven.turn, b))
            put(c.spin, bodies[b], row(driven.spin, b))


@compiled
def held_acceleration(
    first: int, last: int, rows: IntArray, driven: Driven, acceleration: FloatArray
) -> None:
    """Give the driven rows (h,), nodes before bodies, the accelerations they are driven with."""
    for h in range(first, last):
        n = len(driven.a)
        put(acceleration, rows[h], row(driven.a, h) if h < n else row(driven.spin_rate, h - n))


@compiled
def straightened_turns(first: int, last: int, turn: FloatArray) -> None:
    """Remove rounding drift from rotations (k, 3, 3)."""
    for k in range(first, last):
        put_matrix(turn, k, straightened(matrix(turn, k)))


@compiled
def averaged(
    first: int,
    last: int,
    averages: Averages,
    begin_acceleration: FloatArray,
    begin_auxiliary: FloatArray,
    acceleration: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in the auxiliary acceleration at the end of a step, shape (n + k, 3)."""
    am, af = averages.am, averages.af
    for i in range(first, last):
        total = plus(times(1.0 - af, row(acceleration, i)), times(af, row(begin_acceleration, i)))
        put(out, i, times(1.0 / (1.0 - am), minus(total, times(am, row(begin_auxiliary, i)))))


@compiled
def travelled(
    first: int,
    last: int,
    h: float,
    driven: IntArray,
    begin: Configuration,
    c: Configuration,
    moved: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in how far every row went in a step of ``h`` [s], shape (n + k, 3), driven ones marked by 1."""
    for i in range(first, last):
        way = row(moved, i)
        if driven[i]:
            way = times(0.5 * h, plus(rate_of(begin, i), rate_of(c, i)))
            if i < len(c.x):
                way = minus(row(c.x, i), row(begin.x, i))
        put(out, i, way)


@compiled
def doubled_works(
    first: int,
    last: int,
    rows: IntArray,
    one: FloatArray,
    other: FloatArray,
    way: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in twice the works of the mean of two forces (f, 3) on the way of their rows [J], shape (f,)."""
    for f in range(first, last):
        out[f] = dot(plus(row(one, f), row(other, f)), row(way, rows[f]))


@compiled
def half_way(
    first: int,
    last: int,
    h: float,
    driven: IntArray,
    begin: Configuration,
    c: Configuration,
    moved: FloatArray,
    middle: Configuration,
) -> None:
    """Fill in the half-way configuration with the mean velocities of the step."""
    n = len(c.x)
    for i in range(first, last):
        way = row(moved, i)
        if driven[i] and i < n:
            way = minus(row(c.x, i), row(begin.x, i))
        elif driven[i]:
            way = vector_of(product(matrix(c.turn, i - n), transposed(matrix(begin.turn, i - n))))
        _place(begin, middle, i, times(0.5, way))
        _put_rate(middle, i, times(1.0 / h, way))
