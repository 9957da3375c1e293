# SPDX-License-Identifier: Apache-2.0
"""Grey levels between pixels, derivative filters along profiles, and the noise of a picture."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.float32]

PROFILE_STEP = 0.5  # px between samples of a profile
_MEDIAN_TO_SIGMA = 1.4826
_ROUNDING = 0.2887  # standard deviation of rounding to whole grey levels, 1 / sqrt(12)
# Mixed second difference: blind to planes and to edges along the axes; 6 is the root of the sum of squares.
_NOISE_KERNEL = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32) / 6.0


@njit(cache=True)
def _bilinear(picture: Picture, x: float, y: float) -> float:
    """Grey level at pixel coordinates (the centre of the first pixel is 0, 0); NaN outside."""
    rows, columns = picture.shape
    if not (x >= 0.0 and y >= 0.0 and x <= columns - 1 and y <= rows - 1):
        return np.nan
    column = min(int(x), columns - 2)
    row = min(int(y), rows - 2)
    right = x - column
    down = y - row
    upper = picture[row, column] * (1.0 - right) + picture[row, column + 1] * right
    lower = picture[row + 1, column] * (1.0 - right) + picture[row + 1, column + 1] * right
    return float(upper * (1.0 - down) + lower * down)


@njit(cache=True)
def normal_slopes(
    picture: Picture, centres: Array, normals: Array, kernel: Array, count: int, average: int
) -> Array:
    """Smoothed derivative of the grey level along normals, (n, 2 count + 1), grey levels per px.

    Parameters
    ----------
    centres, normals
        (n, 2) pixels, and unit vectors along which profiles run.
    kernel
        Of :func:`derivative_kernel`.
    count
        Samples on either side, `PROFILE_STEP` apart.
    average
        Parallel profiles one pixel apart that are averaged.
    """
    half = len(kernel) // 2
    reach = count + half
    profile = np.empty(2 * reach + 1)
    slopes = np.empty((len(centres), 2 * count + 1))
    for i in range(len(centres)):
        nx = normals[i, 0]
        ny = normals[i, 1]
        for k in range(2 * reach + 1):
            along = (k - reach) * PROFILE_STEP
            total = 0.0
            for j in range(average):
                aside = j - 0.5 * (average - 1)
                x = centres[i, 0] + along * nx - aside * ny
                y = centres[i, 1] + along * ny + aside * nx
                total += _bilinear(picture, x, y)
            profile[k] = total / average
        for k in range(2 * count + 1):
            total = 0.0
            for j in range(len(kernel)):
                total += kernel[j] * profile[k + j]
            slopes[i, k] = total
    return slopes


@lru_cache(maxsize=32)
def derivative_kernel(sigma: float) -> Array:
    """Give the derivative of a Gaussian of width `sigma` [px] at steps of `PROFILE_STEP`, (2 half + 1,)."""
    half = int(np.ceil(3.5 * sigma / PROFILE_STEP))
    offset = np.arange(-half, half + 1) * PROFILE_STEP
    kernel = offset * np.exp(-0.5 * (offset / sigma) ** 2)
    # A ramp of slope one must give exactly one, whatever the sampling of the kernel.
    kernel = kernel / (kernel * offset).sum()
    kernel.setflags(write=False)
    return np.asarray(kernel)


def neighbour_correlation(rays: Array, sigma: float) -> Array:
    """Correlation of edge positions on neighbouring normals, from the pixels they share, (m,) from lag 1.

    The position of an edge is off by the noise of the slope's own derivative, a weighted sum of interpolated
    grey levels. Two bilinear samples of white noise a distance (dx, dy) apart, at pixel phases as they
    come, have the covariance B(dx) B(dy), B the cubic B-spline (a triangle convolved with a triangle).

    Parameters
    ----------
    rays
        (m + 1, samples, average, 2) pixels at which the profiles are read, the middle sample on the edge.
    sigma
        Width of the derivative filter [px].
    """
    weights = np.gradient(derivative_kernel(sigma))
    points = rays.reshape(len(rays), -1, 2)
    repeated = np.repeat(weights, rays.shape[2])
    shared = np.empty(len(rays))
    for lag, other in enumerate(points):
        step = points[0][:, None, :] - other[None, :, :]
        shared[lag] = repeated @ (_cubic_spline(step[..., 0]) * _cubic_spline(step[..., 1])) @ repeated
    return np.asarray(shared[1:] / shared[0])


def _cubic_spline(x: Array) -> Array:
    x = np.abs(x)
    outer = np.clip(2.0 - x, 0.0, None) ** 3 / 6.0
    return np.asarray(np.where(x < 1.0, 2.0 / 3.0 - x**2 + 0.5 * x**3, outer))


def sample_offsets(sigma: float) -> Array:
    """Positions along a normal that the filter of width `sigma` reads around an edge [px]."""
    half = len(derivative_kernel(sigma)) // 2
    return np.asarray(np.arange(-half, half + 1) * PROFILE_STEP)


def noise_level(picture: Picture) -> float:
    """Robust standard deviation of the noise of one pixel [grey levels], at least that of rounding.

    Median absolute response to a filter that sees neither constant brightness nor brightness gradients
    (after Immerkaer, Computer Vision and Image Understanding 64, 1996; here with the median, so that edges
    and texture in less than half of the picture do not count).
    """
    step = max(1, picture.shape[0] // 128)
    strips = picture if step == 1 else _strips(picture, step)
    response = cv2.filter2D(strips, cv2.CV_32F, _NOISE_KERNEL)[1:-1:3, 1:-1]
    return max(_MEDIAN_TO_SIGMA * float(np.median(np.abs(response))), _ROUNDING)


def _strips(picture: Picture, step: int) -> Picture:
    """Keep groups of three neighbouring rows, one group in `step`; the filter needs the neighbours."""
    rows = picture.shape[0] // (3 * step) * 3 * step
    groups = picture[:rows].reshape(-1, 3 * step, picture.shape[1])[:, :3]
    return np.ascontiguousarray(groups.reshape(-1, picture.shape[1]))
