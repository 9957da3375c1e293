# SPDX-License-Identifier: Apache-2.0
"""The light that reaches each pixel from a body, two marks and two rods, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUBPIXELS = 2  # per side, each with its own linear ramp of coverage
_CORNER = 2.0 / 3.0  # radius of the body's corners over half its height
_ROD = 1.5  # half thickness of a rod [px]


@njit(cache=True)
def _cover(distance: float) -> float:
    """Share of a sub-pixel inside a shape whose border is `distance` px away, negative inside."""
    return min(max(0.5 - distance * SUBPIXELS, 0.0), 1.0)


@njit(cache=True)
def _box(ahead: float, up: float, half: float, radius: float) -> float:
    """Signed distance of a box with rounded corners."""
    corner = radius * _CORNER
    dx = abs(ahead) - half + corner
    dy = abs(up) - radius + corner
    outside = np.hypot(max(dx, 0.0), max(dy, 0.0))
    return float(outside + min(max(dx, dy), 0.0) - corner)


@njit(cache=True)
def _rod(ahead: float, up: float, cosine: float, sine: float, length: float) -> float:
    """Signed distance of a rod from the middle of the body."""
    along = min(max(ahead * cosine + up * sine, 0.0), length)
    return float(np.hypot(ahead - along * cosine, up - along * sine) - _ROD)


@njit(cache=True)
def scene_light(grid: Array, poses: Array, shape: Array, levels: Array, rods: Array) -> Array:
    """Mean light over the poses, (rows, columns) of pixels.

    Parameters
    ----------
    grid
        (rows, columns, SUBPIXELS, SUBPIXELS, 2) undistorted place of each sub-pixel from the optical axis.
    poses
        (m, 4) middle of the body (x, y), cosine and sine of its angle of attack.
    shape
        Half length and half height of the body, half distance and radius of the marks (0: none), rod length
        (0: none), mirror (1 or -1), width of the picture and relative shading over it.
    levels
        Grey levels of background, body, marks.
    rods
        (2, 2) cosine and sine of each rod in body axes.
    """
    half, radius, place, mark, length, mirror, width, shading = shape
    rows, columns = grid.shape[0], grid.shape[1]
    light = np.zeros((rows, columns))
    share = 1.0 / (len(poses) * SUBPIXELS * SUBPIXELS)
    for row in range(rows):
        for column in range(columns):
            total = 0.0
            for s in range(SUBPIXELS):
                for t in range(SUBPIXELS):
                    gx = grid[row, column, s, t, 0]
                    gy = grid[row, column, s, t, 1]
                    back = levels[0] * (1.0 - shading * (gx / width + 0.5))
                    for m in range(len(poses)):
                        x = mirror * (gx - poses[m, 0])
                        y = gy - poses[m, 1]
                        # Body axes: `ahead` to the nose, `up` to the back; y of a picture points down.
                        ahead = x * poses[m, 2] - y * poses[m, 3]
                        up = -x * poses[m, 3] - y * poses[m, 2]
                        value = back
                        if length > 0.0:
                            for k in range(2):
                                cover = _cover(_rod(ahead, up, rods[k, 0], rods[k, 1], length))
                                value += cover * (levels[1] - value)
                        value += _cover(_box(ahead, up, half, radius)) * (levels[1] - value)
                        if mark > 0.0 and abs(up) < mark + 1.0:
                            distance = np.hypot(abs(ahead) - place, up) - mark
                            value += _cover(distance) * (levels[2] - value)
                        total += value
            light[row, column] = total * share
    return light
