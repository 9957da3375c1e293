# SPDX-License-Identifier: Apache-2.0
"""Loads on the rows of a structure, row by row: means over a step, and air that is carried along.

Loops run as :mod:`cwmav_sim.wing.arithmetic` says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cwmav_sim.wing.algebra import compiled, dot, minus, plus, put, row, times
from cwmav_sim.wing.motion_loops import rate_of
from cwmav_sim.wing.sheet import FloatArray, IntArray

if TYPE_CHECKING:
    from cwmav_sim.wing.parts import Configuration


@compiled
def at_end(first: int, last: int, share: float, begin: FloatArray, mean: FloatArray, out: FloatArray) -> None:
    """Fill in the load at the end of a step that has a mean load, if the begin counts with its ``share``."""
    for i in range(first, last):
        rest = minus(row(mean, i), times(share, row(begin, i)))
        put(out, i, times(1.0 / (1.0 - share), rest))


@compiled
def between(first: int, last: int, share: float, begin: FloatArray, end: FloatArray, out: FloatArray) -> None:
    """Fill in the load at a share of the way from the begin of a step to its end."""
    for i in range(first, last):
        put(out, i, plus(times(1.0 - share, row(begin, i)), times(share, row(end, i))))


@compiled
def onward(
    first: int, last: int, step: float, c: Configuration, acceleration: FloatArray, out: FloatArray
) -> None:
    """Fill in the rates that accelerations lead to in a step [s], shape (n + k, 3)."""
    for i in range(first, last):
        put(out, i, plus(rate_of(c, i), times(step, row(acceleration, i))))


@compiled
def scaled(first: int, last: int, factor: float, values: FloatArray, out: FloatArray) -> None:
    """Fill in ``factor`` times numbers (n,)."""
    for i in range(first, last):
        out[i] = factor * values[i]


@compiled
def take_resistance(
    first: int,
    last: int,
    blocks: FloatArray,
    rows: IntArray,
    c: Configuration,
    foreseen: FloatArray,
    load: FloatArray,
) -> None:
    """Take off a load the blocks (m, d, d) times how far the rates of their ``rows`` (m, d/3) missed."""
    for m in range(first, last):
        for i in range(3 * rows.shape[1]):
            total = 0.0
            for k in range(rows.shape[1]):
                at = rows[m, k]
                missed = minus(rate_of(c, at), row(foreseen, at))
                for j in range(3):
                    total -= blocks[m, i, 3 * k + j] * missed[j]
            load[rows[m, i // 3], i % 3] += total


@compiled
def node_inertia(first: int, last: int, mass: FloatArray, normal: FloatArray, out: FloatArray) -> None:
    """Fill in the inertia of masses that move along normals, shape (n, 3, 3)."""
    for i in range(first, last):
        for a in range(3):
            for b in range(3):
                out[i, a, b] = mass[i] * normal[i, a] * normal[i, b]


@compiled
def rows_of(first: int, last: int, field: FloatArray, out: FloatArray) -> None:
    """Copy the first rows of a field."""
    for i in range(first, last):
        put(out, i, row(field, i))


@compiled
def sheet_rows(first: int, last: int, forces: FloatArray, out: FloatArray) -> None:
    """Copy forces on nodes (n, 3) to the rows of a structure (n + k, 3); the rest is zero."""
    for i in range(first, last):
        put(out, i, row(forces, i) if i < len(forces) else (0.0, 0.0, 0.0))


@compiled
def squares(first: int, last: int, field: FloatArray, out: FloatArray) -> None:
    """Fill in the squared lengths of vectors (n, 3), shape (n,)."""
    for i in range(first, last):
        out[i] = dot(row(field, i), row(field, i))
