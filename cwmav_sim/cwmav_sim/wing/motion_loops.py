# SPDX-License-Identifier: Apache-2.0
"""Nodes and bodies one by one: sums of forces, inertia, damping and what is out of balance.

Fields of vectors have the rows of :mod:`cwmav_sim.wing.dynamics`: n positions, then k turns. Loops run as
:mod:`cwmav_sim.wing.arithmetic` says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cwmav_sim.wing.algebra import (
    Vector,
    across,
    compiled,
    dot,
    each,
    inlined,
    matrix,
    minus,
    plus,
    put,
    row,
    times,
    turned,
    turned_back,
)
from cwmav_sim.wing.sheet import FloatArray, IntArray

if TYPE_CHECKING:
    from cwmav_sim.wing.parts import Configuration


@inlined
def rate_of(c: Configuration, i: int) -> Vector:
    """Return velocity or spin of a row."""
    return row(c.v, i) if i < len(c.v) else row(c.spin, i - len(c.v))


@compiled
def add_gathered(
    first: int, last: int, starts: IntArray, sources: IntArray, values: FloatArray, total: FloatArray
) -> None:
    """Add to each total (n,) the values (p,) that belong to it, in the order of their places."""
    for i in range(first, last):
        found = total[i]
        for p in range(starts[i], starts[i + 1]):
            found += values[sources[p]]
        total[i] = found


@compiled
def inertial_forces(
    first: int,
    last: int,
    mass: FloatArray,
    rotary: FloatArray,
    c: Configuration,
    acceleration: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in the rates of change of momentum and of angular momentum, shape (n + k, 3)."""
    n = len(mass)
    for i in range(first, last):
        if i < n:
            put(out, i, times(mass[i], row(acceleration, i)))
        else:
            r, j = matrix(c.turn, i - n), row(rotary, i - n)
            own, turning = turned_back(r, row(acceleration, i)), turned_back(r, row(c.spin, i - n))
            put(out, i, turned(r, plus(each(j, own), across(turning, each(j, turning)))))


@compiled
def given_rates(
    first: int,
    last: int,
    mass: FloatArray,
    rotary: FloatArray,
    c: Configuration,
    force: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in the accelerations that forces give, gyroscopic moments apart, shape (n + k, 3)."""
    n = len(mass)
    for i in range(first, last):
        if i < n:
            put(out, i, times(1.0 / mass[i], row(force, i)))
        else:
            r, j = matrix(c.turn, i - n), row(rotary, i - n)
            own = turned_back(r, row(force, i))
            put(out, i, turned(r, (own[0] / j[0], own[1] / j[1], own[2] / j[2])))


@compiled
def inertia_tangent(
    first: int,
    last: int,
    linear: float,
    angular: float,
    mass: FloatArray,
    rotary: FloatArray,
    turn: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in ``linear`` times the masses and ``angular`` times the inertia in space, shape (n + k, 3, 3)."""
    n = len(mass)
    for i in range(first, last):
        for a in range(3):
            for b in range(3):
                found = 0.0
                if i < n:
                    found = linear * mass[i] if a == b else 0.0
                else:
                    for j in range(3):
                        found += turn[i - n, a, j] * (angular * rotary[i - n, j]) * turn[i - n, b, j]
                out[i, a, b] = found


@compiled
def kinetic_energies(
    first: int, last: int, mass: FloatArray, rotary: FloatArray, c: Configuration, out: FloatArray
) -> None:
    """Fill in the kinetic energies [J], shape (n + k,)."""
    n = len(mass)
    for i in range(first, last):
        if i < n:
            out[i] = 0.5 * mass[i] * dot(row(c.v, i), row(c.v, i))
        else:
            own = turned_back(matrix(c.turn, i - n), row(c.spin, i - n))
            out[i] = 0.5 * dot(each(row(rotary, i - n), own), own)


@inlined
def _carried(c: Configuration, carrier_spin: FloatArray, group: IntArray, i: int) -> Vector:
    """Velocity of the carrier frame at node ``i``."""
    return across(row(carrier_spin, group[i]), row(c.x, i))


@compiled
def unbalanced(
    first: int,
    last: int,
    rows: IntArray,
    inertial: FloatArray,
    internal: FloatArray,
    force: FloatArray,
    damping: float,
    mass: FloatArray,
    c: Configuration,
    carrier_spin: FloatArray,
    group: IntArray,
    out: FloatArray,
) -> None:
    """Fill in inertial, internal and drag forces less the external ones, of some rows, shape (f, 3).

    Drag is ``damping`` times the momentum of a node relative to its carrier frame.
    """
    for f in range(first, last):
        i = rows[f]
        total = plus(row(inertial, i), row(internal, i))
        if i < len(mass):
            relative = minus(row(c.v, i), _carried(c, carrier_spin, group, i))
            total = plus(total, times(damping * mass[i], relative))
        put(out, f, minus(total, row(force, i)))


@compiled
def drag_powers(
    first: int,
    last: int,
    damping: float,
    mass: FloatArray,
    c: Configuration,
    carrier_spin: FloatArray,
    group: IntArray,
    lost: FloatArray,
    given: FloatArray,
) -> None:
    """Fill in the powers that drag on each node loses and that it gives to the carriers [W], shape (n,)."""
    for i in range(first, last):
        carried = _carried(c, carrier_spin, group, i)
        relative = minus(row(c.v, i), carried)
        lost[i] = damping * mass[i] * dot(relative, relative)
        given[i] = damping * mass[i] * dot(relative, carried)


@compiled
def turned_rows(
    first: int,
    last: int,
    rotations: FloatArray,
    group: IntArray,
    rows: IntArray,
    a: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in vectors (f, 3) turned by the rotation (g, 3, 3) of the group of each of ``rows`` (f,)."""
    for f in range(first, last):
        put(out, f, turned(matrix(rotations, group[rows[f]]), row(a, f)))
