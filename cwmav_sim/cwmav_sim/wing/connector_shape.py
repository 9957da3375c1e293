# SPDX-License-Identifier: Apache-2.0
"""One connector: how far its ends are strained, and what it bears.

The equations of :mod:`cwmav_sim.wing.connector` up to force and moment in the middle triad. These functions
are inlined: handing over the arrays of two ends takes longer than the arithmetic.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cwmav_sim.wing.algebra import (
    Matrix,
    Vector,
    across,
    dot,
    each,
    inlined,
    matrix,
    minus,
    plus,
    product,
    rotation_by,
    row,
    times,
    transposed,
    turned,
    turned_back,
    vector_of,
)
from cwmav_sim.wing.sheet import FloatArray, IntArray

_STRAIGHT = 1e-6  # relative angle [rad] below which tau and S have their limits


class Ends(NamedTuple):
    """One end of every connector.

    Attributes
    ----------
    nodes, weights : ndarray, shape (m, w)
        Position rows and weights whose sum is the end's position (a body: itself with weight 1).
    body : ndarray, shape (m,)
        Body that carries the triad.
    arm : ndarray, shape (m, 3)
        Offset of the attachment point in the body's material axes [m].
    triad : ndarray, shape (m, 3, 3)
        Triad in the body's material axes.
    """

    nodes: IntArray
    weights: FloatArray
    body: IntArray
    arm: FloatArray
    triad: FloatArray


class Stiffness(NamedTuple):
    """Constants of the connectors.

    Attributes
    ----------
    translation : ndarray, shape (m, 3)
        k_t [N/m] along the axes of the middle triad.
    rotation : ndarray, shape (m, 3)
        k_r [N m/rad] about them.
    rest : ndarray, shape (m, 3)
        Unstrained offset d0 of the ends in the triad [m].
    """

    translation: FloatArray
    rotation: FloatArray
    rest: FloatArray


class Shape(NamedTuple):
    """Kinematics of one connector, in the letters of the equations; ``axis`` is psi's unit vector."""

    arm1: Vector
    arm2: Vector
    d: Vector
    middle: Matrix
    psi: Vector
    p: Vector
    tau: float
    swell: float  # the factor a of S
    axis: Vector


@inlined
def _mean(field: FloatArray, end: Ends, m: int) -> Vector:
    """Position or velocity of an end."""
    out = (0.0, 0.0, 0.0)
    for k in range(end.nodes.shape[1]):
        out = plus(out, times(end.weights[m, k], row(field, end.nodes[m, k])))
    return out


@inlined
def shape_of(x: FloatArray, turn: FloatArray, one: Ends, two: Ends, m: int) -> Shape:
    """Return the kinematics of connector ``m``."""
    turn1, turn2 = matrix(turn, one.body[m]), matrix(turn, two.body[m])
    arm1, arm2 = turned(turn1, row(one.arm, m)), turned(turn2, row(two.arm, m))
    d = minus(minus(plus(_mean(x, two, m), arm2), _mean(x, one, m)), arm1)
    r1, r2 = product(turn1, matrix(one.triad, m)), product(turn2, matrix(two.triad, m))
    psi = vector_of(product(transposed(r1), r2))
    angle = math.sqrt(dot(psi, psi))
    tau, swell, axis = 0.25, 1.0, (0.0, 0.0, 0.0)
    if angle >= _STRAIGHT:
        tau, swell = math.tan(0.25 * angle) / angle, 0.5 * angle / math.sin(0.5 * angle)
        axis = times(1.0 / angle, psi)
    middle = product(r1, rotation_by(times(0.5, psi)))
    return Shape(arm1, arm2, d, middle, psi, turned(middle, psi), tau, swell, axis)


@inlined
def swollen(s: Shape, a: Vector) -> Vector:
    """Return S a."""
    return plus(times(s.swell, a), times((1.0 - s.swell) * dot(s.axis, a), s.axis))


@inlined
def middle_spin(s: Shape, spin1: Vector, spin2: Vector) -> Vector:
    """Return the angular velocity of the middle triad."""
    lag = times(0.5 * s.tau, across(s.p, minus(spin2, spin1)))
    return minus(times(0.5, plus(spin1, spin2)), lag)


@inlined
def strain_rates(
    v: FloatArray, spin: FloatArray, one: Ends, two: Ends, m: int, s: Shape
) -> tuple[Vector, Vector]:
    """Return the rates of the strains e and psi."""
    spin1, spin2 = row(spin, one.body[m]), row(spin, two.body[m])
    flow = minus(_mean(v, two, m), _mean(v, one, m))
    flow = plus(flow, minus(across(spin2, s.arm2), across(spin1, s.arm1)))
    stretch = turned_back(s.middle, minus(flow, across(middle_spin(s, spin1, spin2), s.d)))
    return stretch, swollen(s, turned_back(s.middle, minus(spin2, spin1)))


@inlined
def resultants(
    v: FloatArray,
    spin: FloatArray,
    one: Ends,
    two: Ends,
    stiffness: Stiffness,
    viscosity: float,
    m: int,
    s: Shape,
) -> tuple[Vector, Vector]:
    """Return force and moment, elastic and viscous, in the middle triad."""
    stretch, bend = minus(turned_back(s.middle, s.d), row(stiffness.rest, m)), s.psi
    if viscosity > 0.0:
        stretching, bending = strain_rates(v, spin, one, two, m, s)
        stretch, bend = plus(stretch, times(viscosity, stretching)), plus(bend, times(viscosity, bending))
    return each(row(stiffness.translation, m), stretch), each(row(stiffness.rotation, m), bend)
