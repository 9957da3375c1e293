# SPDX-License-Identifier: Apache-2.0
"""Samples taken at the same point: merged into one before a correlation matrix sees them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def merge_replicates(X: Array, y: Array, noise: Array) -> tuple[Array, Array, Array, list[str]]:
    """Merge samples at identical points.

    With noise variances the merged response is the inverse-variance mean. Without, responses that
    contradict each other reveal noise: their pooled variance (the pure error of regression analysis)
    becomes the noise of every sample.

    Parameters
    ----------
    X : (n, d) array
    y : (n,) array
    noise : (n,) array
        Variances; all zero when unknown.

    Returns
    -------
    X, y, noise : arrays
        Of the distinct points, in order of first appearance; the inputs themselves when all are distinct.
    recoveries : list of str
        What was done, empty when nothing.
    """
    _, first, group, counts = np.unique(X, axis=0, return_index=True, return_inverse=True, return_counts=True)
    if len(first) == len(X):
        return X, y, noise, []
    group = group.reshape(-1)
    recoveries = [f"replicates merged: {len(X)} samples at {len(first)} points"]
    exact = noise == 0.0
    if np.any(exact) and not np.all(exact):
        # Among replicates an exact response outweighs any number of noisy ones.
        has_exact = np.bincount(group, exact) > 0
        weight = np.where(exact, 1.0, np.where(has_exact[group], 0.0, 1.0 / np.where(exact, 1.0, noise)))
    else:
        weight = np.ones(len(y)) if np.all(exact) else 1.0 / noise
    total = np.bincount(group, weight)
    mean = np.bincount(group, weight * y) / total
    merged_noise = np.zeros(len(first))
    if np.all(exact):
        scatter = float(np.sum((y - mean[group]) ** 2))
        if scatter > (1e-12 * float(np.abs(y).max())) ** 2 * len(y):
            pooled = scatter / (len(y) - len(first))
            merged_noise = pooled / counts
            recoveries.append(f"replicates disagree: noise standard deviation {np.sqrt(pooled):.3g} assumed")
    else:
        merged_noise = np.where(np.bincount(group, exact) > 0, 0.0, 1.0 / total)
    order = np.argsort(first)
    return X[first[order]], mean[order], merged_noise[order], recoveries
