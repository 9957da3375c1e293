# SPDX-License-Identifier: Apache-2.0
"""Universal Kriging for given hyperparameters: Appendix I of the paper, Eqs. 15 to 20.

Nothing here is estimated but the trend coefficients and the process variance; the length scales come from
:mod:`cwmav_rbdo.likelihood`, units and scaling from :mod:`cwmav_rbdo.kriging`. The correlation matrix
carries on its diagonal, relative to the process variance, the noise variance of each sample and a nugget
against singularity.

The inverse of the Cholesky factor is formed once, because it turns every prediction into matrix products.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, cholesky, lapack, qr

from cwmav_rbdo.correlation import Correlation, squared_distance
from cwmav_rbdo.trend import basis, basis_gradient

Array = NDArray[np.float64]

LARGEST_NUGGET = 1e-6
"""Beyond it a correlation matrix counts as singular."""


@dataclass(frozen=True)
class Process:
    """What the samples are taken to be: trend plus Gaussian process (Eqs. 15 and 16)."""

    correlation: Correlation
    trend: str
    length_scale: Array
    """(d,) length scales l of the correlation function."""
    nugget: float
    """Added to the diagonal of R, relative to the process variance."""


@dataclass(frozen=True)
class Fitted:
    """A process conditioned on samples: all that Eqs. 17 to 20 need."""

    process: Process
    X: Array
    """(n, d) samples."""
    f: Array
    """(n,) responses."""
    noise: Array
    """(n,) variance of the noise of each response, in squared units of f."""
    L_inv: Array
    """(n, n) inverse of the Cholesky factor of R, so that R^-1 = L_inv' L_inv."""
    F: Array
    """(n, p) L_inv H."""
    G_inv: Array
    """(p, p) inverse of the triangular factor of F, so that (H' R^-1 H)^-1 = G_inv G_inv'."""
    v: Array
    """(p,) trend coefficients, Eq. 17."""
    gamma: Array
    """(n,) R^-1 (f - H v) of Eq. 18."""
    process_variance: float
    """sigma_Delta^2 of Eq. 16."""


def correlation_matrix(process: Process, X: Array, noise: Array, process_variance: float) -> Array:
    """R of Eq. 17, with noise and nugget on the diagonal; (n, n)."""
    R = process.correlation.value(squared_distance(X, X, process.length_scale))
    R[np.diag_indices_from(R)] += process.nugget
    if np.any(noise):
        R[np.diag_indices_from(R)] += noise / process_variance
    return R


def cholesky_factor(R: Array) -> tuple[Array, float]:
    """Factorise R, with the least nugget added that lets the factorisation succeed.

    Parameters
    ----------
    R : (n, n) array
        Only the lower triangle is read.

    Returns
    -------
    L : (n, n) array
        Lower triangular, Fortran order.
    added : float
        What was added to the diagonal, zero in the regular case.

    Raises
    ------
    numpy.linalg.LinAlgError
        If R is singular even with the largest nugget, 1e-6.
    """
    added = 0.0
    while True:
        L, info = lapack.dpotrf(R, lower=1)
        if info == 0:
            return L, added
        if added >= LARGEST_NUGGET:
            raise np.linalg.LinAlgError("singular correlation matrix")
        more = max(9.0 * added, len(R) * np.finfo(float).eps)
        R = R + more * np.eye(len(R))
        added += more


def condition(
    process: Process, X: Array, f: Array, noise: Array, process_variance: float | None = None
) -> Fitted:
    """Condition a process on samples.

    Parameters
    ----------
    process : Process
    X : (n, d) array
    f : (n,) array
    noise : (n,) array
        Noise variances; all zero when the responses are exact.
    process_variance : float, optional
        Needed with noise; without it the maximum-likelihood value (f - H v)' R^-1 (f - H v) / n is taken.
    """
    variance = 1.0 if process_variance is None else process_variance
    L, added = cholesky_factor(correlation_matrix(process, X, noise, variance))
    L_inv, _ = lapack.dtrtri(L, lower=1)
    if added:
        process = replace(process, nugget=process.nugget + added)
    return solve(process, X, f, noise, L_inv, process_variance)


def solve(
    process: Process, X: Array, f: Array, noise: Array, L_inv: Array, process_variance: float | None
) -> Fitted:
    """Solve the generalised least squares of Eq. 17 for a factor that is already there."""
    F = L_inv @ basis(process.trend, X)
    whitened = L_inv @ f
    Q, G = qr(F, mode="economic", check_finite=False)
    G_inv, _ = lapack.dtrtri(G)
    v = G_inv @ (Q.T @ whitened)  # Eq. 17
    residual = whitened - F @ v
    gamma = L_inv.T @ residual
    if process_variance is None:
        process_variance = float(residual @ residual) / len(f)
    return Fitted(process, X, f, noise, L_inv, F, np.triu(G_inv), v, gamma, process_variance)


def correlation_vector(fitted: Fitted, X_new: Array) -> tuple[Array, Array]:
    """r(x_new) of Eq. 19 for each row of X_new, and the squared scaled distances; both (m, n)."""
    s = squared_distance(X_new, fitted.X, fitted.process.length_scale)
    return fitted.process.correlation.value(s), s


def predict(fitted: Fitted, X_new: Array) -> Array:
    """Prediction of Eq. 18 for the rows of X_new; (m,)."""
    r, _ = correlation_vector(fitted, X_new)
    mean: Array = basis(fitted.process.trend, X_new) @ fitted.v + r @ fitted.gamma
    return mean


def predict_with_mse(fitted: Fitted, X_new: Array) -> Array:
    """Prediction of Eq. 18 and its mean square error, Eq. 20, in the two columns of an (m, 2) array.

    The error is that of the response without noise. Rounding can leave it slightly negative at a sample; it
    is then zero.
    """
    out = np.empty((len(X_new), 2))
    r, _ = correlation_vector(fitted, X_new)
    h = basis(fitted.process.trend, X_new)
    out[:, 0] = h @ fitted.v + r @ fitted.gamma
    whitened = blas.dtrmm(1.0, fitted.L_inv, r.T, lower=1, overwrite_b=1).T
    u = (whitened @ fitted.F - h) @ fitted.G_inv
    reduction = np.einsum("ij,ij->i", whitened, whitened)
    mse = fitted.process_variance * (1.0 - reduction + np.einsum("ij,ij->i", u, u))  # Eq. 20
    np.maximum(mse, 0.0, out=out[:, 1])
    return out


def _weighted_slope(fitted: Fitted, X_new: Array, slope: Array, weights: Array) -> Array:
    """Sum over the samples of weights times the gradient of r; weights (m, n) or (n,), result (m, d)."""
    c = slope * weights
    towards = X_new * c.sum(axis=1)[:, None] - c @ fitted.X
    weighted: Array = 2.0 * towards / fitted.process.length_scale**2
    return weighted


def gradient(fitted: Fitted, X_new: Array) -> Array:
    """Gradient of the prediction of Eq. 18; (m, d)."""
    r, s = correlation_vector(fitted, X_new)
    slope = fitted.process.correlation.slope(s, r)
    dh = basis_gradient(fitted.process.trend, X_new)
    through_h = np.einsum("mpd,p->md", dh, fitted.v)
    return np.asarray(through_h + _weighted_slope(fitted, X_new, slope, fitted.gamma))


def mse_gradient(fitted: Fitted, X_new: Array) -> Array:
    """Gradient of the mean square error of Eq. 20; (m, d)."""
    r, s = correlation_vector(fitted, X_new)
    slope = fitted.process.correlation.slope(s, r)
    h = basis(fitted.process.trend, X_new)
    dh = basis_gradient(fitted.process.trend, X_new)
    whitened = r @ fitted.L_inv.T
    u = whitened @ fitted.F - h
    a = u @ fitted.G_inv @ fitted.G_inv.T
    weights = (a @ fitted.F.T - whitened) @ fitted.L_inv
    through_r = _weighted_slope(fitted, X_new, slope, weights)
    through_h = np.einsum("mpd,mp->md", dh, a)
    return np.asarray(2.0 * fitted.process_variance * (through_r - through_h))


def leave_one_out(fitted: Fitted) -> tuple[Array, Array]:
    """Leave-one-out errors and their variances in closed form (Dubrule 1983, Math. Geol. 15:687).

    Length scales and process variance stay; the trend is solved anew without each sample.

    Returns
    -------
    error : (n,) array
        Response minus its prediction from the other samples.
    variance : (n,) array
        Predicted variance of that error, noise of the left-out sample included.
    """
    projected = fitted.F @ fitted.G_inv
    half = fitted.L_inv.T @ projected
    diagonal = np.einsum("ij,ij->j", fitted.L_inv, fitted.L_inv) - np.einsum("ij,ij->i", half, half)
    diagonal = np.maximum(diagonal, np.finfo(float).tiny)
    return fitted.gamma / diagonal, fitted.process_variance / diagonal


def loo_log_density(fitted: Fitted) -> float:
    """Sum of the logarithms of the predictive density of each sample, given all others.

    Unlike the mean square of the leave-one-out errors it is not ruled by the few samples at the rim.
    """
    error, variance = leave_one_out(fitted)
    if fitted.process_variance == 0.0:
        return math.inf
    return float(-0.5 * np.sum(np.log(2.0 * np.pi * variance) + error**2 / variance))


def border(fitted: Fitted, X_new: Array, f_new: Array, noise_new: Array, keep_variance: bool) -> Fitted:
    """Add samples to a fitted process by bordering its factor, in O(n^2) per sample.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the new samples make the correlation matrix singular.
    """
    n = len(fitted.X)
    variance = fitted.process_variance if keep_variance else 1.0
    corner = correlation_matrix(fitted.process, X_new, noise_new, variance)
    cross, _ = correlation_vector(fitted, X_new)
    side = cross @ fitted.L_inv.T
    corner_factor = cholesky(corner - side @ side.T, lower=True, check_finite=False)
    corner_inv, _ = lapack.dtrtri(np.asfortranarray(corner_factor), lower=1)
    corner_inv = np.tril(corner_inv)
    L_inv = np.zeros((n + len(X_new), n + len(X_new)), order="F")
    L_inv[:n, :n] = fitted.L_inv
    L_inv[n:, n:] = corner_inv
    L_inv[n:, :n] = -corner_inv @ side @ fitted.L_inv
    return solve(
        fitted.process,
        np.vstack([fitted.X, X_new]),
        np.concatenate([fitted.f, f_new]),
        np.concatenate([fitted.noise, noise_new]),
        L_inv,
        fitted.process_variance if keep_variance else None,
    )
