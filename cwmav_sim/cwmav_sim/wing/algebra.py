# SPDX-License-Identifier: Apache-2.0
"""Vectors and rotations of one node or body: what the compiled loops over elements are made of.

A vector is a tuple of three numbers, a matrix a tuple of its three rows. They live in registers, nothing is
allocated, and every function is plain scalar code without a sum whose order a compiler may change. Closed
forms of rotations and their series for small angles follow Iserles et al., Acta Numerica 9 (2000), and Simo &
Vu-Quoc, CMAME 58 (1986).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numba

from cwmav_sim.wing.sheet import FloatArray

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

_Function = TypeVar("_Function", bound=Callable[..., object])

_SMALL = 1e-4  # angle [rad] below which the series, exact to rounding there, replaces the closed form


def compiled(function: _Function) -> _Function:
    """Compile a function of the structure: IEEE arithmetic in double precision, kept on disk."""
    out: _Function = numba.njit(cache=True, error_model="numpy")(function)
    return out


def inlined(function: _Function) -> _Function:
    """Compile a small function into its callers, because a call would take longer than what it does."""
    out: _Function = numba.njit(cache=True, error_model="numpy", forceinline=True)(function)
    return out


@inlined
def row(a: FloatArray, i: int) -> Vector:
    """Return row ``i`` of a field of vectors (n, 3)."""
    return a[i, 0], a[i, 1], a[i, 2]


@inlined
def put(a: FloatArray, i: int, vector: Vector) -> None:
    """Write a vector to row ``i`` of a field (n, 3)."""
    a[i, 0], a[i, 1], a[i, 2] = vector


@inlined
def matrix(a: FloatArray, i: int) -> Matrix:
    """Return matrix ``i`` of a stack (n, 3, 3)."""
    return (
        (a[i, 0, 0], a[i, 0, 1], a[i, 0, 2]),
        (a[i, 1, 0], a[i, 1, 1], a[i, 1, 2]),
        (a[i, 2, 0], a[i, 2, 1], a[i, 2, 2]),
    )


@inlined
def put_matrix(a: FloatArray, i: int, m: Matrix) -> None:
    """Write a matrix to place ``i`` of a stack (n, 3, 3)."""
    a[i, 0, 0], a[i, 0, 1], a[i, 0, 2] = m[0]
    a[i, 1, 0], a[i, 1, 1], a[i, 1, 2] = m[1]
    a[i, 2, 0], a[i, 2, 1], a[i, 2, 2] = m[2]


@inlined
def unit(axis: int) -> Vector:
    """Return the unit vector along an axis."""
    return 1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0


@inlined
def plus(a: Vector, b: Vector) -> Vector:
    """Return ``a + b``."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def minus(a: Vector, b: Vector) -> Vector:
    """Return ``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(factor: float, a: Vector) -> Vector:
    """Return ``factor a``."""
    return factor * a[0], factor * a[1], factor * a[2]


@inlined
def each(a: Vector, b: Vector) -> Vector:
    """Return the products of the components."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Return ``a . b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def across(a: Vector, b: Vector) -> Vector:
    """Return ``a x b``."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def turned(r: Matrix, a: Vector) -> Vector:
    """Return ``r a``."""
    return dot(r[0], a), dot(r[1], a), dot(r[2], a)


@inlined
def turned_back(r: Matrix, a: Vector) -> Vector:
    """Return ``r' a``."""
    return (
        r[0][0] * a[0] + r[1][0] * a[1] + r[2][0] * a[2],
        r[0][1] * a[0] + r[1][1] * a[1] + r[2][1] * a[2],
        r[0][2] * a[0] + r[1][2] * a[1] + r[2][2] * a[2],
    )


@inlined
def product(a: Matrix, b: Matrix) -> Matrix:
    """Return ``a b``."""
    return turned_back(b, a[0]), turned_back(b, a[1]), turned_back(b, a[2])


@inlined
def transposed(a: Matrix) -> Matrix:
    """Return ``a'``."""
    return (a[0][0], a[1][0], a[2][0]), (a[0][1], a[1][1], a[2][1]), (a[0][2], a[1][2], a[2][2])


@inlined
def rotation_by(vector: Vector) -> Matrix:
    """Return the rotation by the angle ``|vector|`` [rad] about ``vector`` (Rodrigues)."""
    square = dot(vector, vector)
    angle = math.sqrt(square)
    if angle < _SMALL:
        first, second = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    x, y, z = vector
    along = 1.0 - second * square
    return (
        (second * x * x + along, second * x * y - first * z, second * x * z + first * y),
        (second * y * x + first * z, second * y * y + along, second * y * z - first * x),
        (second * z * x - first * y, second * z * y + first * x, second * z * z + along),
    )


@inlined
def vector_of(r: Matrix) -> Vector:
    """Return the rotation vector of ``r``, for angles below pi."""
    axis = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    sine = 0.5 * math.sqrt(dot(axis, axis))
    angle = math.atan2(sine, 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0))
    return times(0.5 + angle * angle / 12.0 if angle < _SMALL else 0.5 * angle / sine, axis)


@inlined
def joined(vector: Vector, change: Vector) -> Vector:
    """Return the rotation vector of ``exp(change) exp(vector)`` to first order in ``change``.

    Baker-Campbell-Hausdorff series to second order in ``vector``.
    """
    once = across(vector, change)
    return plus(minus(plus(vector, change), times(0.5, once)), times(1.0 / 12.0, across(vector, once)))


@inlined
def straightened(r: Matrix) -> Matrix:
    """Return ``r`` with rounding drift removed by one Newton step of the polar decomposition."""
    gram = product(transposed(r), r)
    rows = (
        minus((1.5, 0.0, 0.0), times(0.5, gram[0])),
        minus((0.0, 1.5, 0.0), times(0.5, gram[1])),
        minus((0.0, 0.0, 1.5), times(0.5, gram[2])),
    )
    return product(r, rows)
