# SPDX-License-Identifier: Apache-2.0
"""First guess of the body edge: a Hough transform in which every pixel votes along its own gradient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from cwmav_rig.angle.sampling import Picture
from cwmav_rig.angle.settings import AngleSettings

Array = NDArray[np.float64]

_LARGEST_SIDE = 320  # px of the reduced picture
# The smoothed gradient of white noise has a standard deviation of 0.12 of it; votes need five times that.
_GRADIENT_NOISE = 0.6
_SPREAD = np.arange(-4, 5)  # degrees around the gradient direction that a pixel votes for


@dataclass(frozen=True)
class Seed:
    """A line in recorded pixels: a point on it and the unit normal towards its bright side, (2,) each."""

    point: Array
    normal: Array


def find_seed(picture: Picture, noise: float, settings: AngleSettings) -> Seed | None:
    """Find the longest edge of the wanted kind in the region `picture`; None when there is none."""
    small = _reduce(picture)
    scale = np.array([picture.shape[1] / small.shape[1], picture.shape[0] / small.shape[0]])
    votes = _gradient_pixels(small, noise / float(scale.max()), settings)
    if votes is None:
        return None
    x, y, direction, weight = votes
    angle, distance = _peak(x, y, direction, weight, small.shape)
    normal = np.array([np.cos(angle), np.sin(angle)])
    centre = np.array([small.shape[1] - 1, small.shape[0] - 1]) / 2
    point = (centre + distance * normal + 0.5) * scale - 0.5
    normal = normal / scale  # a normal goes with the inverse of the scale
    return Seed(point, normal / np.hypot(*normal))


def clip_to(seed: Seed, width: int, height: int) -> tuple[float, float] | None:
    """Give the range of arc length from ``seed.point`` for which the line lies in a picture of this size."""
    direction = np.array([-seed.normal[1], seed.normal[0]])
    low, high = -np.inf, np.inf
    for start, step, size in zip(seed.point, direction, (width, height), strict=True):
        if abs(step) < 1e-12:
            if not 0 <= start <= size - 1:
                return None
            continue
        ends = sorted(((0 - start) / step, (size - 1 - start) / step))
        low, high = max(low, ends[0]), min(high, ends[1])
    return (low, high) if high > low else None


def _reduce(picture: Picture) -> Picture:
    factor = _LARGEST_SIDE / max(picture.shape)
    small = picture
    if factor < 1:
        size = (max(8, round(picture.shape[1] * factor)), max(8, round(picture.shape[0] * factor)))
        small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), 1.2), dtype=np.float32)


def _gradient_pixels(
    small: Picture, noise: float, settings: AngleSettings
) -> tuple[Array, Array, Array, Array] | None:
    """Give x, y (from the centre), direction [rad] and magnitude of pixels on edges of the wanted kind."""
    gx = cv2.Scharr(small, cv2.CV_32F, 1, 0, scale=1 / 32)
    gy = cv2.Scharr(small, cv2.CV_32F, 0, 1, scale=1 / 32)
    magnitude = np.asarray(cv2.magnitude(gx, gy))
    wanted = magnitude > max(_GRADIENT_NOISE * noise, 0.2 * float(np.percentile(magnitude[::2, ::2], 99.8)))
    if settings.edge != "strongest":
        bright_above = (settings.body == "dark") == (settings.edge == "upper")
        wanted &= (gy < 0) if bright_above else (gy > 0)
    rows, columns = np.nonzero(wanted)
    direction = np.arctan2(gy[rows, columns], gx[rows, columns]).astype(float)
    shown = edge_angle(direction, settings) - settings.correction
    shown = (shown + np.pi / 2) % np.pi - np.pi / 2
    margin = np.deg2rad(_SPREAD[-1])
    low, high = np.deg2rad(settings.angle_min_deg) - margin, np.deg2rad(settings.angle_max_deg) + margin
    keep = (shown > low) & (shown < high)
    if not keep.any():
        return None
    rows, columns, direction = rows[keep], columns[keep], direction[keep]
    x = columns - (small.shape[1] - 1) / 2
    y = rows - (small.shape[0] - 1) / 2
    return x, y, direction, magnitude[rows, columns].astype(float)


def edge_angle(normal_angle: Array, settings: AngleSettings) -> Array:
    """Turn the direction of normals [rad, x towards y] into the angle of the edge, nose up positive."""
    line = normal_angle + np.pi / 2
    shown = -line if settings.nose == "right" else line
    return np.asarray((shown + np.pi / 2) % np.pi - np.pi / 2)


@lru_cache(maxsize=1)
def _circle() -> tuple[Array, Array]:
    angles = np.deg2rad(np.arange(360))
    return np.cos(angles), np.sin(angles)


def _peak(x: Array, y: Array, direction: Array, weight: Array, shape: tuple[int, ...]) -> tuple[float, float]:
    """Accumulate (direction, distance) in bins of 1 degree and 1 px and give the smoothed maximum."""
    reach = int(np.ceil(np.hypot(shape[0], shape[1]) / 2)) + 2
    bins = 2 * reach + 1
    cosine, sine = _circle()
    degrees = (np.rint(np.rad2deg(direction)).astype(np.intp)[:, None] + _SPREAD[None, :]) % 360
    distance = x[:, None] * cosine[degrees] + y[:, None] * sine[degrees]
    cell = degrees * bins + np.rint(distance).astype(np.intp) + reach
    weights = np.repeat(weight, len(_SPREAD))
    table = np.bincount(cell.ravel(), weights=weights, minlength=360 * bins).reshape(360, bins)
    wrapped = np.vstack([table[-1:], table, table[:1]])
    smooth = cv2.blur(wrapped, (3, 3), borderType=cv2.BORDER_CONSTANT)[1:-1]
    angle, place = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    return float(np.deg2rad(angle)), float(place - reach)
