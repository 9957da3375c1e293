# SPDX-License-Identifier: Apache-2.0
"""Prediction on a whole tensor grid at the price of one matrix product.

The Gaussian correlation is a product over the variables, and so is every monomial of the trend. Eq. 18 of
the paper on the grid is therefore a sum of outer products of one-dimensional vectors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.threads import for_each_block
from cwmav_rbdo.trend import terms

Array = NDArray[np.float64]


BLOCK = 1 << 18
"""Nodes computed at once in double precision."""


def predict_on_grid(model: Kriging, axes: Sequence[Array]) -> NDArray[np.float32]:
    """Predict the mean of a fitted model at every node of a tensor grid.

    Parameters
    ----------
    model : Kriging
        Fitted.
    axes : sequence of d arrays
        Nodes of each variable in its units.

    Returns
    -------
    array of shape (len(axes[0]), ..., len(axes[d - 1]))
        Single precision, computed in double: the coefficients of Eq. 18 are large and cancel.
    """
    shape = tuple(len(axis) for axis in axes)
    if not isinstance(model, Kriging) or model.kernel != "gaussian":
        return _point_by_point(model, axes)
    fitted = model.fitted_
    columns = terms(fitted.process.trend, fitted.X.shape[1])
    coefficients = np.concatenate([fitted.gamma, fitted.v])
    factors = []
    inner = 0
    for k, axis in enumerate(axes):
        if not model.active_[k]:
            factors.append(np.ones((len(axis), len(coefficients))))
            continue
        z = (np.asarray(axis, dtype=np.float64) - model.x_offset_[k]) / model.x_scale_[k]
        scaled = (z[:, None] - fitted.X[:, inner]) / fitted.process.length_scale[inner]
        powers = np.array([term.count(inner) for term in columns])
        factors.append(np.hstack([np.exp(-0.5 * scaled**2), z[:, None] ** powers]))
        inner += 1
    rest = coefficients[None, :]
    for factor in factors[1:]:
        rest = (rest[:, None, :] * factor[None, :, :]).reshape(-1, len(coefficients))
    out = np.empty((shape[0], len(rest)), dtype=np.float32)
    rows = max(BLOCK // len(rest), 1)

    def fill(block: slice) -> None:
        out[block] = factors[0][block] @ rest.T

    for_each_block(fill, [slice(start, start + rows) for start in range(0, shape[0], rows)])
    out *= np.float32(model.y_scale_)
    out += np.float32(model.y_offset_)
    return out.reshape(shape)


def _point_by_point(model: Kriging, axes: Sequence[Array]) -> NDArray[np.float32]:
    out = np.empty(tuple(len(axis) for axis in axes), dtype=np.float32)
    for row, first in enumerate(axes[0]):
        mesh = np.meshgrid([first], *axes[1:], indexing="ij")
        mean = model.predict(np.stack([m.ravel() for m in mesh], axis=1))
        out[row] = np.asarray(mean).reshape(out.shape[1:])
    return out
