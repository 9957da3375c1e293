# SPDX-License-Identifier: Apache-2.0
"""Reliability everywhere in a box at once: the failed set blurred by the scatter.

For independent normal scatter the probability of failure as a function of the design is the indicator of
failure, convolved with the normal density. On a regular grid that is a separable filter; afterwards a swarm
looks its particles up. The hard indicator would need a fine grid, so part of the variance is put into it:
with the limit state linear over a fraction of a standard deviation, ``Phi(-g / (w |grad g|))`` is the
indicator blurred by w, and the filter does the remaining ``1 - w^2``, both in units of the scatter.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates, spline_filter
from scipy.special import ndtr

from cwmav_common.errors import InputError
from cwmav_rbdo.reliability.inputs import LimitState
from cwmav_rbdo.space import checked_bounds

Array = NDArray[np.float64]

REACH = 4.5
"""Margin around the box and length of the filter in standard deviations; beyond lies 7e-6."""
LARGEST_GRID = 30_000_000
BLOCK = 200_000
SHARE = 0.7
"""Blur of the indicator in grid steps: enough against aliasing, little beside the curvature of the limit."""


@runtime_checkable
class GridLimitState(Protocol):
    """A limit state that is faster on a whole grid than point by point."""

    def on_grid(self, axes: list[Array]) -> NDArray[np.floating]:
        """Evaluate on the tensor grid of the axes; result has their lengths as shape."""
        ...


class ConvolvedField:
    """Probability of failure of every design in a box, for up to three variables that scatter independently.

    Parameters
    ----------
    g : callable or GridLimitState
        Limit state, failed where <= 0; also evaluated up to 4.5 standard deviations outside the box.
    lo, hi : (d,) arrays
        Box of the designs, d <= 3.
    std : (d,) array
        Standard deviations, > 0.
    step : float
        Grid spacing in standard deviations; 0.7 suits a screen, 0.5 is finer.

    Attributes
    ----------
    field : array
        Spline coefficients of the probability on the grid.
    evaluations : int
        Grid points.

    Raises
    ------
    InputError
        On more than three variables, a zero standard deviation, a grid of more than 30 million points.
    """

    def __init__(
        self, g: LimitState | GridLimitState, lo: ArrayLike, hi: ArrayLike, std: ArrayLike, step: float = 0.7
    ) -> None:
        lower, upper = checked_bounds(lo, hi)
        spread = np.asarray(std, dtype=np.float64)
        if len(lower) > 3:
            raise InputError(f"convolved field: {len(lower)} variables, at most 3")
        if spread.shape != lower.shape or not np.all(np.isfinite(spread) & (spread > 0.0)):
            raise InputError(f"convolved field: std {spread}; allowed are {len(lower)} finite numbers > 0")
        if not 0.1 <= step <= 1.2:
            raise InputError(f"convolved field: step {step}; allowed is 0.1 to 1.2 standard deviations")
        margin = REACH * spread
        counts = np.ceil((upper - lower + 2.0 * margin) / (step * spread)).astype(int) + 1
        self.evaluations = int(np.prod(counts))
        if self.evaluations > LARGEST_GRID:
            raise InputError(
                f"convolved field: {self.evaluations} grid points, at most {LARGEST_GRID}; "
                "a larger step or a smaller box is needed"
            )
        self.origin = lower - margin
        self.spacing = step * spread
        axes = [self.origin[k] + self.spacing[k] * np.arange(counts[k]) for k in range(len(lower))]
        blurred = _soft_indicator(_grid_values(g, axes))
        remaining = np.sqrt(1.0 - (step * SHARE) ** 2) / step
        for axis in range(len(lower)):
            gaussian_filter1d(blurred, remaining, axis=axis, output=blurred, mode="nearest", truncate=REACH)
        self.field = spline_filter(blurred, order=3, output=np.float32, mode="nearest")

    def failure_probability(self, X: ArrayLike) -> Array:
        """Look designs (m, d) up, by cubic interpolation; (m,)."""
        index = (np.asarray(X, dtype=np.float64) - self.origin) / self.spacing
        found = map_coordinates(
            self.field, index.T, order=3, mode="nearest", prefilter=False, output=np.float64
        )
        return np.asarray(np.clip(found, 0.0, 1.0))


def _grid_values(g: LimitState | GridLimitState, axes: list[Array]) -> NDArray[np.float32]:
    if isinstance(g, GridLimitState):
        return np.asarray(g.on_grid(axes), dtype=np.float32)
    shape = tuple(len(axis) for axis in axes)
    values = np.empty(int(np.prod(shape)), dtype=np.float32)
    for first in range(0, len(values), BLOCK):
        flat = np.arange(first, min(first + BLOCK, len(values)))
        index = np.unravel_index(flat, shape)
        points = np.stack([axis[i] for axis, i in zip(axes, index, strict=True)], axis=1)
        values[flat] = g(points)
    return values.reshape(shape)


def _soft_indicator(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """``Phi(-g / (w |grad g|))`` with w = 0.7 steps; the gradient is per step, so the spacing cancels."""
    squared = np.zeros_like(values)
    for axis in range(values.ndim):
        difference = np.gradient(values, axis=axis)
        np.multiply(difference, difference, out=difference)
        squared += difference
    np.sqrt(squared, out=squared)
    squared *= SHARE
    np.maximum(squared, np.float32(1e-30), out=squared)
    np.divide(values, squared, out=squared)
    np.clip(squared, -9.0, 9.0, out=squared)
    return np.asarray(ndtr(np.negative(squared, out=squared)), dtype=np.float32)
