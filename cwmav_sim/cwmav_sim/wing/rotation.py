# SPDX-License-Identifier: Apache-2.0
"""Finite rotations of many bodies at once: exponential, logarithm and cross-product matrices.

All functions work on the last axes, so one call serves every node of a wing. Closed forms and their series
for small angles follow Iserles et al., Acta Numerica 9 (2000), and Simo & Vu-Quoc, CMAME 58 (1986).
"""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.sheet import FloatArray

_SMALL = 1e-4  # angle [rad] below which the series, exact to rounding there, replaces the closed form


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
    square = np.einsum("...i,...i->...", vector, vector)
    angle = np.sqrt(square)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0 - square / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(safe)) / safe**2)
    matrix = skew(vector)
    out = first[..., None, None] * matrix + second[..., None, None] * (matrix @ matrix)
    return np.asarray(out + np.eye(3))


def logarithm(rotation: FloatArray) -> FloatArray:
    """Return the rotation vector of ``rotation``, for angles below pi, shape (..., 3)."""
    axis = np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    sine = 0.5 * np.sqrt(np.einsum("...i,...i->...", axis, axis))
    cosine = 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    small = angle < _SMALL
    factor = np.where(small, 0.5 + angle**2 / 12.0, 0.5 * angle / np.where(small, 1.0, sine))
    return np.asarray(factor[..., None] * axis)


def compounded(vector: FloatArray, change: FloatArray) -> FloatArray:
    """Return the rotation vector of ``exp(change) exp(vector)`` to first order in ``change``.

    Baker-Campbell-Hausdorff series to second order in ``vector``.
    """
    once = cross(vector, change)
    return vector + change - 0.5 * once + cross(vector, once) / 12.0


def orthonormal(rotation: FloatArray) -> FloatArray:
    """Return ``rotation`` with rounding drift removed by one Newton step of the polar decomposition."""
    gram = np.swapaxes(rotation, -1, -2) @ rotation
    return np.asarray(rotation @ (1.5 * np.eye(3) - 0.5 * gram))
