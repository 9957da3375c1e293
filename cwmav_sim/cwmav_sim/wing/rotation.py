# SPDX-License-Identifier: Apache-2.0
"""Finite rotations of many bodies at once: exponential, compounds and cross-product matrices.

All functions work on the last axes, so one call serves every node of a wing. The formulas for one body are in
:mod:`cwmav_sim.wing.algebra`.
"""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.algebra import (
    compiled,
    joined,
    put,
    put_matrix,
    rotation_by,
    row,
)
from cwmav_sim.wing.sheet import FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return ``a x b`` over the last axis; quicker than ``numpy.cross`` for short arrays."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def skew(a: FloatArray) -> FloatArray:
    """Return the matrix that multiplies a vector as ``a x``, shape (..., 3, 3)."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def turn(rotation: FloatArray, a: FloatArray) -> FloatArray:
    """Return ``rotation @ a`` for stacks of rotations (..., 3, 3) and vectors (..., 3)."""
    return np.asarray(np.matmul(rotation, a[..., None])[..., 0])


def turn_back(rotation: FloatArray, a: FloatArray) -> FloatArray:
    """Return ``rotation.T @ a`` for stacks of rotations and vectors."""
    return np.asarray(np.matmul(a[..., None, :], rotation)[..., 0, :])


def exponential(vector: FloatArray) -> FloatArray:
    """Return the rotation by the angle ``|vector|`` [rad] about ``vector``, shape (..., 3, 3)."""
    return _exponentials(_rows(vector)).reshape(*vector.shape, 3)


def compounded(vector: FloatArray, change: FloatArray) -> FloatArray:
    """Return the rotation vector of ``exp(change) exp(vector)`` to first order in ``change``."""
    return _compounds(_rows(vector), _rows(change)).reshape(vector.shape)


def _rows(a: FloatArray) -> FloatArray:
    return np.ascontiguousarray(a, dtype=np.float64).reshape(-1, 3)


@compiled
def _exponentials(vectors: FloatArray) -> FloatArray:
    out = np.empty((len(vectors), 3, 3))
    for i in range(len(vectors)):
        put_matrix(out, i, rotation_by(row(vectors, i)))
    return out


@compiled
def _compounds(vectors: FloatArray, changes: FloatArray) -> FloatArray:
    out = np.empty((len(vectors), 3))
    for i in range(len(vectors)):
        put(out, i, joined(row(vectors, i), row(changes, i)))
    return out
