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
    """Cover of a box with rounded corners."""
    corner = radius * _CORNER
    dx = abs(ahead) - half + corner
    dy = abs(up) - radius + corner
    if max(dx, dy) > corner + 1.0:
        return 0.0
    if dx > 0.0 and dy > 0.0:
        return float(_cover(np.sqrt(dx * dx + dy * dy) - corner))
    return float(_cover(max(dx, dy) - corner))


@njit(cache=True)
def _rod(ahead: float, up: float, cosine: float, sine: float, length: float) -> float:
    """Cover of a rod that starts at the middle of the body."""
    aside = abs(up * cosine - ahead * sine)
    along = ahead * cosine + up * sine
    if aside > _ROD + 1.0 or along < -_ROD - 1.0 or along > length + _ROD + 1.0:
        return 0.0
    beyond = max(-along, along - length, 0.0)
    return float(_cover(np.sqrt(aside * aside + beyond * beyond) - _ROD))


@njit(cache=True)
def _mark(ahead: float, up: float, place: float, radius: float) -> float:
    """Cover of the two marks."""
    dx = abs(ahead) - place
    if abs(dx) > radius + 1.0 or abs(up) > radius + 1.0:
        return 0.0
    return float(_cover(np.sqrt(dx * dx + up * up) - radius))


@njit(cache=True)
def _paint(ahead: float, up: float, back: float, shape: Array, levels: Array, rods: Array) -> float:
    """Grey level at one sub-pixel, in body axes."""
    half, radius, place, mark, length = shape[0], shape[1], shape[2], shape[3], shape[4]
    value = back
    if length > 0.0:
        for k in range(2):
            value += _rod(ahead, up, rods[k, 0], rods[k, 1], length) * (levels[1] - value)
    value += _box(ahead, up, half, radius) * (levels[1] - value)
    if mark > 0.0:
        value += _mark(ahead, up, place, mark) * (levels[2] - value)
    return float(value)


@njit(cache=True)
def _far_from_borders(ahead: float, up: float, margin: float, shape: Array, rods: Array) -> bool:
    """Say that no border of any shape comes within `margin` px."""
    half, radius, place, mark, length = shape[0], shape[1], shape[2], shape[3], shape[4]
    outside = abs(ahead) > half + margin or abs(up) > radius + margin
    inside = abs(ahead) < half - radius - margin and abs(up) < radius - margin
    if not (outside or inside):
        return False
    if inside:
        return bool(mark == 0.0 or abs(np.hypot(abs(ahead) - place, up) - mark) > margin)
    if length > 0.0:
        for k in range(2):
            aside = abs(up * rods[k, 0] - ahead * rods[k, 1])
            along = ahead * rods[k, 0] + up * rods[k, 1]
            if aside < _ROD + margin and -margin - _ROD < along < length + _ROD + margin:
                return False
    return True


@njit(cache=True)
def scene_light(grid: Array, poses: Array, shape: Array, levels: Array, rods: Array, travel: float) -> Array:
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
    travel
        Farthest that anything moves between the poses [px]; pixels farther from all borders are drawn once.
    """
    mirror, width, shading = shape[5], shape[6], shape[7]
    rows, columns = grid.shape[0], grid.shape[1]
    light = np.zeros((rows, columns))
    middle = len(poses) // 2
    for row in range(rows):
        for column in range(columns):
            total = 0.0
            count = 0
            still = False
            for s in range(SUBPIXELS):
                for t in range(SUBPIXELS):
                    gx = grid[row, column, s, t, 0]
                    gy = grid[row, column, s, t, 1]
                    back = levels[0] * (1.0 - shading * (gx / width + 0.5))
                    for k in range(len(poses)):
                        # The middle pose of the first sub-pixel tells whether the others can differ.
                        m = (k + middle) % len(poses)
                        x = mirror * (gx - poses[m, 0])
                        y = gy - poses[m, 1]
                        # Body axes: `ahead` to the nose, `up` to the back; y of a picture points down.
                        ahead = x * poses[m, 2] - y * poses[m, 3]
                        up = -x * poses[m, 3] - y * poses[m, 2]
                        if k == 0 and s == 0 and t == 0:
                            still = _far_from_borders(ahead, up, travel + 3.0, shape, rods)
                        total += _paint(ahead, up, back, shape, levels, rods)
                        count += 1
                        if still:
                            break
            light[row, column] = total / count
    return light
