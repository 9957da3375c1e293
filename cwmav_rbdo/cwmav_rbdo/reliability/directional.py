# SPDX-License-Identifier: Apache-2.0
"""Directional quadrature: rays from the design in all directions, each integrated exactly; many designs.

Where failure lies all around a design, as below a percentile near a maximum, no direction is the one in
which the limit state falls, and lines across the safe region miss its rim. Rays do not: along each the
radius of standard normal points has a chi distribution, and the mean over the directions is a sum over equal
angles, which converges faster than any power where the limit state is smooth (Bjerager 1988, J. Eng. Mech.
114:1285, with quadrature in place of random directions).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincc

from cwmav_common.errors import InputError
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.inputs import LimitState
from cwmav_rbdo.reliability.line_root import checked_designs, failed_on_lines

Array = NDArray[np.float64]

LARGEST_DIMENSION = 3
REACH = 6.5
"""Length of the rays in standard deviations."""
RAY_POINTS = 14


def directional(
    g: LimitState, designs: ArrayLike, std: ArrayLike, angles: int = 48
) -> tuple[Array, Array, int]:
    """Probability of failure of many designs under independent normal scatter.

    Parameters
    ----------
    g : callable
        Physical points (n, d) -> (n,), failed where <= 0.
    designs : (m, d) array
        Variables that scatter must be at most three.
    std : (d,) array, or (m, d)
        Standard deviations.
    angles : int
        Directions around a circle, a multiple of four; in three variables half as many circles.

    Returns
    -------
    pf : (m,) array
    error : (m,) array
        Difference to half as many angles.
    evaluations : int

    Raises
    ------
    InputError
        On more than three scattering variables or wrong shapes.
    """
    X, shifts = checked_designs(designs, std, LARGEST_DIMENSION, "directional")
    if angles < 4 or angles % 4:
        raise InputError(f"angles = {angles}: allowed is a multiple of 4")
    m, k = shifts.shape[:2]
    if k == 0:
        return (np.asarray(g(X)) <= 0.0).astype(np.float64), np.zeros(m), m
    pf, used = _mean_over_rays(g, X, shifts, *_directions(k, angles))
    if k == 1:
        return pf, np.zeros(m), used
    coarse, more = _mean_over_rays(g, X, shifts, *_directions(k, angles // 2))
    return pf, np.abs(pf - coarse), used + more


def directional_estimate(g: LimitState, design: ArrayLike, std: ArrayLike, angles: int = 96) -> Estimate:
    """Probability of failure of one design, as an :class:`Estimate`; see :func:`directional`."""
    pf, error, evaluations = directional(g, np.asarray(design, dtype=np.float64)[None], std, angles)
    return Estimate(float(pf[0]), float(error[0]), evaluations, "directional")


def _directions(k: int, angles: int) -> tuple[Array, Array]:
    """Give unit vectors (n, k) and weights (n,) that add up to one."""
    if k == 1:
        return np.array([[1.0], [-1.0]]), np.array([0.5, 0.5])
    # Turned by an irrational part of a step, so that no axis of the problem falls on a node by chance.
    phi = 2.0 * np.pi * (np.arange(angles) + 0.381966) / angles
    circle = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    if k == 2:
        return circle, np.full(angles, 1.0 / angles)
    heights, weights = np.polynomial.legendre.leggauss(angles // 2)
    radius = np.sqrt(1.0 - heights**2)
    points = np.concatenate(
        [np.column_stack([r * circle, np.full(angles, z)]) for r, z in zip(radius, heights, strict=True)]
    )
    return points, np.repeat(0.5 * weights / angles, angles)


def _mean_over_rays(
    g: LimitState, X: Array, shifts: Array, directions: Array, weights: Array
) -> tuple[Array, int]:
    m, k = shifts.shape[:2]
    along = np.einsum("nk,mkd->mnd", directions, shifts).reshape(m * len(directions), -1)
    base = np.repeat(X, len(directions), axis=0)

    def on_rays(rows: NDArray[np.int_], t: Array) -> Array:
        return np.asarray(g(base[rows] + t[:, None] * along[rows]), dtype=np.float64)

    failed, evaluations = failed_on_lines(
        on_rays, len(base), np.linspace(0.0, REACH, RAY_POINTS), lambda r: gammaincc(0.5 * k, 0.5 * r**2)
    )
    return failed.reshape(m, -1) @ weights, evaluations
