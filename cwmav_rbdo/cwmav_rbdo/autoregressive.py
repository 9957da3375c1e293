# SPDX-License-Identifier: Apache-2.0
"""Joint Gaussian process of several levels of a model, for given hyperparameters.

Kennedy and O'Hagan (2000, Biometrika 87:1): level 0 is a process of its own, and
``y_l(x) = rho_l y_(l-1)(x) + delta_l(x)``. Written out, ``y_l = sum_(k <= l) w_lk delta_k`` with
``w_lk = rho_(k+1) ... rho_l``, so samples of all levels share one covariance matrix and every sample tells
something about every level, whether or not the levels were run at the same points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, qr

from cwmav_rbdo.correlation import Correlation, squared_distance
from cwmav_rbdo.trend import basis, basis_gradient
from cwmav_rbdo.universal_kriging import cholesky_factor

Array = NDArray[np.float64]
_NUGGET = 1e-10  # relative to the variance of a sample: above rounding, below any noise


@dataclass(frozen=True)
class Increment:
    """One of the independent processes delta_k, in the units of the samples it is conditioned on."""

    correlation: Correlation
    trend: str
    length_scale: Array
    variance: float


@dataclass(frozen=True)
class Joint:
    """All levels conditioned on all samples."""

    increments: tuple[Increment, ...]
    weights: Array
    """(levels, levels) w_lk, zero for k > l."""
    X: Array
    level: NDArray[np.int_]
    y: Array
    noise: Array
    L_inv: Array
    F: Array
    G_inv: Array
    v: Array
    gamma: Array


def condition(
    increments: Sequence[Increment],
    rho: Sequence[float],
    X: Array,
    level: NDArray[np.int_],
    y: Array,
    noise: Array,
) -> Joint:
    """Condition the levels on samples.

    Parameters
    ----------
    increments : one per level, coarse to fine
    rho : factors of the steps, one fewer
    X, level, y, noise : (n, d), (n,), (n,), (n,) arrays
        Points, indices of their levels, responses and variances of their errors.
    """
    W = _weights(rho)
    K = np.zeros((len(X), len(X)))
    for k, part in enumerate(increments):
        w = W[level, k]
        K += (
            np.outer(w, w) * part.variance * part.correlation.value(squared_distance(X, X, part.length_scale))
        )
    diagonal = np.diag(K).copy()
    K[np.diag_indices_from(K)] += noise + _NUGGET * diagonal
    # Factorised as a correlation matrix, whose diagonal of ones the nugget of the factorisation is meant for.
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    L, _ = cholesky_factor(np.asfortranarray(K / np.outer(size, size)))
    L_inv = np.tril(lapack.dtrtri(L, lower=1)[0]) / size
    F = L_inv @ _trend(increments, W[level], X)
    whitened = L_inv @ y
    Q, G = qr(F, mode="economic", check_finite=False)
    G_inv = np.triu(lapack.dtrtri(G)[0])
    v = G_inv @ (Q.T @ whitened)
    gamma = L_inv.T @ (whitened - F @ v)
    return Joint(tuple(increments), W, X, level, y, noise, L_inv, F, G_inv, v, gamma)


def predict(joint: Joint, X_new: Array) -> tuple[Array, Array]:
    """Mean and mean square error of the finest level; (m,) each."""
    top = joint.weights[-1]
    r = sum(c * part.correlation.value(s) for part, c, s in _covariances(joint, X_new))
    h = _trend(joint.increments, np.tile(top, (len(X_new), 1)), X_new)
    whitened = r @ joint.L_inv.T
    u = (whitened @ joint.F - h) @ joint.G_inv
    prior = sum(w**2 * part.variance for w, part in zip(top, joint.increments, strict=True))
    mse = prior - np.sum(whitened**2, axis=1) + np.sum(u**2, axis=1)
    return np.asarray(h @ joint.v + r @ joint.gamma), np.maximum(mse, 0.0)


def gradients(joint: Joint, X_new: Array) -> tuple[Array, Array]:
    """Gradients of mean and of mean square error; (m, d) each."""
    top = joint.weights[-1]
    parts = list(_covariances(joint, X_new))
    r = sum(c * part.correlation.value(s) for part, c, s in parts)
    tops = np.tile(top, (len(X_new), 1))
    h, dh = _trend(joint.increments, tops, X_new), _trend_gradient(joint.increments, top, X_new)
    whitened = r @ joint.L_inv.T
    a = (whitened @ joint.F - h) @ joint.G_inv @ joint.G_inv.T
    weights = (a @ joint.F.T - whitened) @ joint.L_inv
    mean, mse = np.einsum("mpd,p->md", dh, joint.v), -2.0 * np.einsum("mpd,mp->md", dh, a)
    for part, c, s in parts:
        slope = c * part.correlation.slope(s, part.correlation.value(s))
        mean += _through(joint, X_new, part, slope * joint.gamma)
        mse += 2.0 * _through(joint, X_new, part, slope * weights)
    return mean, mse


def _weights(rho: Sequence[float]) -> Array:
    W = np.eye(len(rho) + 1)
    for level, factor in enumerate(rho, 1):
        W[level] += factor * W[level - 1]
    return W


def _covariances(joint: Joint, X_new: Array) -> list[tuple[Increment, Array, Array]]:
    """Give each increment, its covariance with the samples at no distance (n,), and the distances (m, n)."""
    top = joint.weights[-1]
    return [
        (
            part,
            top[k] * joint.weights[joint.level, k] * part.variance,
            squared_distance(X_new, joint.X, part.length_scale),
        )
        for k, part in enumerate(joint.increments)
    ]


def _through(joint: Joint, X_new: Array, part: Increment, c: Array) -> Array:
    towards = X_new * c.sum(axis=1)[:, None] - c @ joint.X
    return np.asarray(2.0 * towards / part.length_scale**2)


def _trend(increments: Sequence[Increment], weights: Array, X: Array) -> Array:
    """Regressors of all increments, each weighted as its increment is; (n, sum of coefficients)."""
    return np.hstack([weights[:, k, None] * basis(part.trend, X) for k, part in enumerate(increments)])


def _trend_gradient(increments: Sequence[Increment], top: Array, X: Array) -> Array:
    return np.concatenate(
        [w * basis_gradient(part.trend, X) for w, part in zip(top, increments, strict=True)], axis=1
    )
