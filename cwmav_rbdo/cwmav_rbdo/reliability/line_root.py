# SPDX-License-Identifier: Apache-2.0
"""Line-root quadrature: exact along one direction, Gauss-Hermite across it; deterministic, many designs.

For a design x with independent normal scatter, the standard normal space is turned so that its first axis
points where the limit state falls fastest. On a line along that axis the failed part is found by roots, all
of them, and its probability is a sum of values of Phi; the mean over the lines is a Gauss-Hermite sum over
the other axes. The result is smooth in the design, so a gradient optimiser can use it.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from cwmav_common.errors import InputError
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.inputs import LimitState

Array = NDArray[np.float64]

REACH = 6.0
"""Half length of the lines in standard deviations; beyond lies 2e-9."""
LINE_POINTS = 25
REFINEMENTS = 3
GRADIENT_STEP = 1.0
LARGEST_DIMENSION = 4
Line = Callable[[NDArray[np.int_], Array], Array]
"""Rows of the lines and positions on them -> limit state."""


def line_root(g: LimitState, designs: ArrayLike, std: ArrayLike, order: int = 9) -> tuple[Array, Array, int]:
    """Probability of failure of many designs under independent normal scatter.

    Parameters
    ----------
    g : callable
        Physical points (n, d) -> (n,), failed where <= 0.
    designs : (m, d) array
        Variables that scatter must be at most four; the rest is passed through.
    std : (d,) array, or (m, d)
        Standard deviations, zero for a variable that does not scatter; one row per design where they vary
        over the space.
    order : int
        Gauss-Hermite nodes per axis across the line.

    Returns
    -------
    pf : (m,) array
    error : (m,) array
        Difference to the sum of half as many nodes, an estimate of the quadrature error, pessimistic where
        g is smooth.
    evaluations : int

    Raises
    ------
    InputError
        On more than four scattering variables, a wrong order or wrong shapes.
    """
    X, shifts = checked_designs(designs, std, LARGEST_DIMENSION, "line_root")
    if order < 3:
        raise InputError(f"order = {order}: allowed is an integer >= 3")
    if shifts.shape[1] == 0:
        return (np.asarray(g(X)) <= 0.0).astype(np.float64), np.zeros(len(X)), len(X)
    axes, used = _turned_axes(g, X, shifts)
    pf, used_fine = _quadrature(g, X, axes, shifts, order)
    if shifts.shape[1] == 1:
        return pf, np.zeros(len(X)), used + used_fine
    coarse, used_coarse = _quadrature(g, X, axes, shifts, (order + 1) // 2)
    return pf, np.abs(pf - coarse), used + used_fine + used_coarse


def line_root_estimate(g: LimitState, design: ArrayLike, std: ArrayLike, order: int = 15) -> Estimate:
    """Probability of failure of one design, as an :class:`Estimate`; see :func:`line_root`."""
    pf, error, evaluations = line_root(
        g, np.atleast_1d(np.asarray(design, dtype=np.float64))[None], std, order
    )
    return Estimate(float(pf[0]), float(error[0]), evaluations, "line_root")


def checked_designs(designs: ArrayLike, std: ArrayLike, largest: int, method: str) -> tuple[Array, Array]:
    """Check designs and scatter.

    Returns
    -------
    X : (m, d) array
    shifts : (m, k, d) array
        Step of one standard deviation in each of the k variables that scatter.

    Raises
    ------
    InputError
        On wrong shapes, or more than `largest` scattering variables.
    """
    X = np.atleast_2d(np.asarray(designs, dtype=np.float64))
    spread = np.asarray(std, dtype=np.float64)
    if spread.shape not in (X.shape[1:], X.shape) or not np.all(np.isfinite(spread) & (spread >= 0.0)):
        raise InputError(f"std: {spread}, expected {X.shape[1]} finite numbers >= 0, or a row a design")
    spread = np.broadcast_to(spread, X.shape)
    active = np.flatnonzero(np.any(spread > 0.0, axis=0))
    if len(active) > largest:
        raise InputError(
            f"{method}: {len(active)} scattering variables, at most {largest}; "
            "importance_sampling takes any number"
        )
    shifts = np.zeros((len(X), len(active), X.shape[1]))
    shifts[:, np.arange(len(active)), active] = spread[:, active]
    return X, shifts


def _turned_axes(g: LimitState, X: Array, shifts: Array) -> tuple[Array, int]:
    """Orthonormal axes (m, k, k) of each design, the first along the falling gradient of the limit state."""
    m, k = shifts.shape[:2]
    steps = GRADIENT_STEP * np.concatenate([shifts, -shifts], axis=1)
    values = np.asarray(g((X[:, None, :] + steps).reshape(m * 2 * k, -1))).reshape(m, 2, k)
    downhill = values[:, 1] - values[:, 0]
    size = np.linalg.norm(downhill, axis=1, keepdims=True)
    downhill = np.where(size > 0.0, downhill / np.where(size > 0.0, size, 1.0), np.eye(k)[0])
    # A Householder reflection that maps the first unit vector on the direction; its columns are the axes. Its
    # sign is chosen against cancellation; on a line that runs both ways it does not matter.
    sign = np.where(downhill[:, :1] >= 0.0, 1.0, -1.0)
    w = downhill + sign * np.eye(k)[0]
    reflection = np.eye(k) - 2.0 * w[:, :, None] * w[:, None, :] / np.sum(w**2, axis=1)[:, None, None]
    return np.swapaxes(reflection, 1, 2), m * 2 * k


def _quadrature(g: LimitState, X: Array, axes: Array, shifts: Array, order: int) -> tuple[Array, int]:
    """Weighted sum over the lines; axes (m, k, k), rows are unit vectors."""
    m, k = shifts.shape[:2]
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    weights = weights / weights.sum()
    grid = np.array(list(product(nodes, repeat=k - 1))).reshape(order ** (k - 1), k - 1)
    across = np.ones(1)
    for _ in range(k - 1):
        across = np.multiply.outer(across, weights).reshape(-1)
    physical = axes @ shifts
    base = X[:, None, :] + np.einsum("qa,mad->mqd", grid, physical[:, 1:])
    base = base.reshape(m * len(across), -1)
    along = np.repeat(physical[:, 0], len(across), axis=0)

    def on_lines(rows: NDArray[np.int_], t: Array) -> Array:
        return np.asarray(g(base[rows] + t[:, None] * along[rows]), dtype=np.float64)

    pf, evaluations = failed_on_lines(on_lines, len(base))
    return pf.reshape(m, -1) @ across, evaluations


def failed_on_lines(
    on_lines: Line, count: int, t: Array | None = None, beyond: Callable[[Array], Array] = lambda t: ndtr(-t)
) -> tuple[Array, int]:
    """Integrate a density over the failed part of each line, all sign changes counted.

    Parameters
    ----------
    on_lines : limit state on the lines
    count : number of lines
    t : (p,) array, optional
        Positions at which a line is looked at first; by default 25 from -6 to 6.
    beyond : callable
        Probability of a position beyond the given one, by default of the standard normal density.

    Returns
    -------
    failed : (count,) array
    evaluations : int
    """
    t = np.linspace(-REACH, REACH, LINE_POINTS) if t is None else t
    rows = np.repeat(np.arange(count), len(t))
    values = on_lines(rows, np.tile(t, count)).reshape(count, len(t))
    failed = values <= 0.0
    row, left = np.nonzero(failed[:, :-1] != failed[:, 1:])
    root = _refined(on_lines, row, t[left], t[left + 1], values[row, left], values[row, left + 1])
    # Each crossing adds or removes what lies beyond it; failure at the first position counts from before it.
    pf = failed[:, 0] * 1.0
    into_failure = np.where(failed[row, left + 1], 1.0, -1.0)
    np.add.at(pf, row, into_failure * beyond(root))
    # A line failed from the start has pf = 1 there, and its first crossing takes the right part away.
    return np.clip(pf, 0.0, 1.0), count * len(t) + REFINEMENTS * len(row)


def _refined(
    on_lines: Line, row: NDArray[np.int_], low: Array, high: Array, g_low: Array, g_high: Array
) -> Array:
    """Bracketed roots by the Illinois variant of the false position."""
    root = _crossing(low, high, g_low, g_high)
    if len(row) == 0:  # no line crosses: a surrogate need not accept an empty set of points
        return root
    moved_low = np.zeros(len(row), dtype=bool)
    for step in range(REFINEMENTS):
        value = on_lines(row, root)
        inside_low = (value <= 0.0) == (g_low <= 0.0)
        # An end that stays a second time has its value halved, or the bracket would close from one side only.
        stays = (inside_low == moved_low) & (step > 0)
        g_low = np.where(inside_low, value, np.where(stays, 0.5 * g_low, g_low))
        g_high = np.where(inside_low, np.where(stays, 0.5 * g_high, g_high), value)
        low, high = np.where(inside_low, root, low), np.where(inside_low, high, root)
        moved_low = inside_low
        root = _crossing(low, high, g_low, g_high)
    return root


def _crossing(low: Array, high: Array, g_low: Array, g_high: Array) -> Array:
    difference = g_high - g_low
    fraction = np.where(difference != 0.0, -g_low / np.where(difference != 0.0, difference, 1.0), 0.5)
    return np.asarray(low + np.clip(fraction, 0.0, 1.0) * (high - low))
