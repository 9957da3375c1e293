# SPDX-License-Identifier: Apache-2.0
"""Nodes and bodies one by one: inertia, damping and the corrections of a time step.

Fields of vectors have the rows of :mod:`cwmav_sim.wing.dynamics`: n positions, then k turns.
"""

from __future__ import annotations

import math

import numpy as np

from cwmav_sim.wing.algebra import (
    across,
    compiled,
    dot,
    each,
    joined,
    matrix,
    minus,
    plus,
    product,
    put,
    put_matrix,
    rotation_by,
    row,
    times,
    turned,
    turned_back,
)
from cwmav_sim.wing.sheet import FloatArray, IntArray


@compiled
def largest(values: FloatArray) -> float:
    """Return the largest absolute value of a field (n, 3), not a number where one is not."""
    most = 0.0
    for i in range(len(values)):
        for k in range(3):
            size = abs(values[i, k])
            if math.isnan(size):
                return math.nan
            most = max(most, size)
    return most


@compiled
def add_forces(total: FloatArray, dofs: IntArray, forces: FloatArray) -> None:
    """Add forces (m, d) of elements to those of their scalar unknowns (m, d) in ``total`` (3 (n + k),)."""
    for m in range(dofs.shape[0]):
        for k in range(dofs.shape[1]):
            total[dofs[m, k]] += forces[m, k]


@compiled
def inertial_forces(
    mass: FloatArray, rotary: FloatArray, turn: FloatArray, spin: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Return the rates of change of momentum and of angular momentum, shape (n + k, 3)."""
    out = np.empty((len(mass) + len(turn), 3))
    n = len(mass)
    for i in range(n):
        put(out, i, times(mass[i], row(acceleration, i)))
    for k in range(len(turn)):
        r, j = matrix(turn, k), row(rotary, k)
        own, turning = turned_back(r, row(acceleration, n + k)), turned_back(r, row(spin, k))
        put(out, n + k, turned(r, plus(each(j, own), across(turning, each(j, turning)))))
    return out


@compiled
def kinetic_energy(
    mass: FloatArray, rotary: FloatArray, v: FloatArray, turn: FloatArray, spin: FloatArray
) -> float:
    """Return the kinetic energy [J]."""
    total = 0.0
    for i in range(len(mass)):
        total += 0.5 * mass[i] * dot(row(v, i), row(v, i))
    for k in range(len(turn)):
        own = turned_back(matrix(turn, k), row(spin, k))
        total += 0.5 * dot(each(row(rotary, k), own), own)
    return total


@compiled
def drag_forces(
    factor: float, mass: FloatArray, x: FloatArray, v: FloatArray, carrier_spin: FloatArray, group: IntArray
) -> FloatArray:
    """Return ``factor`` times the momentum relative to the carrier frames, zero for turns, (n + k, 3)."""
    out = np.zeros((len(group), 3))
    for i in range(len(mass)):
        relative = minus(row(v, i), across(row(carrier_spin, group[i]), row(x, i)))
        put(out, i, times(factor * mass[i], relative))
    return out


@compiled
def drag_powers(
    factor: float, mass: FloatArray, x: FloatArray, v: FloatArray, carrier_spin: FloatArray, group: IntArray
) -> tuple[float, float]:
    """Return the power that drag loses and the power that it gives to the carriers [W]."""
    lost, given = 0.0, 0.0
    for i in range(len(mass)):
        carried = across(row(carrier_spin, group[i]), row(x, i))
        relative = minus(row(v, i), carried)
        lost += factor * mass[i] * dot(relative, relative)
        given += factor * mass[i] * dot(relative, carried)
    return lost, given


@compiled
def displaced(x: FloatArray, turn: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and rotations after displacements and rotation vectors (n + k, 3)."""
    x1, turn1, n = np.empty((len(x), 3)), np.empty((len(turn), 3, 3)), len(x)
    for i in range(n):
        put(x1, i, plus(row(x, i), row(moved, i)))
    for k in range(len(turn)):
        put_matrix(turn1, k, product(rotation_by(row(moved, n + k)), matrix(turn, k)))
    return x1, turn1


@compiled
def further(moved: FloatArray, change: FloatArray, free: IntArray, nodes: int) -> FloatArray:
    """Return what a correction ``change`` (f, 3) of the free rows adds to the displacement of the step.

    Displacements add up; rotation vectors compound.
    """
    out = np.zeros((len(moved), 3))
    for f in range(len(free)):
        i, d = free[f], row(change, f)
        put(out, i, d if i < nodes else minus(joined(row(moved, i), d), row(moved, i)))
    return out


@compiled
def turned_rows(rotations: FloatArray, group: IntArray, rows: IntArray, a: FloatArray) -> FloatArray:
    """Return vectors (f, 3) turned by the rotation (g, 3, 3) of the group of each of ``rows`` (f,)."""
    out = np.empty((len(rows), 3))
    for f in range(len(rows)):
        put(out, f, turned(matrix(rotations, group[rows[f]]), row(a, f)))
    return out
