# SPDX-License-Identifier: Apache-2.0
"""Edge points with sub-pixel precision, and the line of the body edge through them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.angle.camera_model import Camera
from cwmav_rig.angle.coarse import clip_to, find_seed
from cwmav_rig.angle.evidence import Evidence, Reason, Refused
from cwmav_rig.angle.robust import Line, fit_line
from cwmav_rig.angle.sampling import (
    PROFILE_STEP,
    Picture,
    derivative_kernel,
    neighbour_correlation,
    normal_slopes,
    sample_offsets,
)
from cwmav_rig.angle.settings import AngleSettings, Finder

Array = NDArray[np.float64]

_DETECTION = 5.0  # a gradient counts from this many standard deviations of its noise


@dataclass(frozen=True)
class EdgePoints:
    """Edge points along a row of normals.

    Attributes
    ----------
    slots
        (n,) numbers of the normals at which an edge was found.
    points
        (n, 2) their pixels.
    contrast
        (n,) step of grey level across the edge.
    blur
        (n,) standard deviation of the spread of the edge [px], beyond that of the filter.
    std
        (n,) standard deviation of the position that the noise of the pixels would give [px].
    """

    slots: NDArray[np.int64]
    points: Array
    contrast: Array
    blur: Array
    std: Array


def find_points(
    picture: Picture, centres: Array, normals: Array, noise: float, finder: Finder, reach: float
) -> EdgePoints:
    """Look for the strongest dark-to-bright step along each normal.

    Parameters
    ----------
    centres, normals
        (m, 2) pixels where to look, and unit vectors towards the bright side.
    noise
        Standard deviation of a pixel.
    reach
        How far from the centre an edge may lie [px].
    """
    kernel = derivative_kernel(finder.gradient_sigma_px)
    count = int(np.ceil(reach / PROFILE_STEP))
    centres, normals = np.ascontiguousarray(centres), np.ascontiguousarray(normals)
    slope = normal_slopes(picture, centres, normals, kernel, count, finder.average)
    rows = np.arange(len(slope))
    with np.errstate(invalid="ignore"):
        peak = np.argmax(np.where(np.isfinite(slope), slope, -np.inf), axis=1)
    inner = np.clip(peak, 1, 2 * count - 1)
    before, top, after = slope[rows, inner - 1], slope[rows, inner], slope[rows, inner + 1]
    bend = before - 2 * top + after
    # White noise averaged over the parallel profiles; interpolation between pixels only lowers it.
    white = noise / np.sqrt(finder.average)
    threshold = _DETECTION * white * np.sqrt((kernel**2).sum())
    with np.errstate(invalid="ignore"):
        found = (peak == inner) & (top > threshold) & (bend < 0)
    before, top, after, bend = before[found], top[found], after[found], bend[found]
    offset = (inner[found] - count + 0.5 * (before - after) / bend) * PROFILE_STEP
    # A Gaussian edge of total spread s gives the slope a maximum A and there a curvature -A / s^2.
    spread_squared = top / (-bend / PROFILE_STEP**2)
    contrast = top * np.sqrt(2 * np.pi * spread_squared)
    blur = np.sqrt(np.maximum(spread_squared - finder.gradient_sigma_px**2, 0.0))
    # The position is off by the noise of the slope's derivative over the curvature of the slope.
    std = white * np.sqrt((np.gradient(kernel, PROFILE_STEP) ** 2).sum()) / (-bend / PROFILE_STEP**2)
    points = centres[found] + offset[:, None] * normals[found]
    return EdgePoints(np.flatnonzero(found), points, contrast, blur, std)


def subset(found: EdgePoints, keep: NDArray[np.bool_]) -> EdgePoints:
    """Keep some of the points."""
    return EdgePoints(
        found.slots[keep], found.points[keep], found.contrast[keep], found.blur[keep], found.std[keep]
    )


def measure_edge(
    picture: Picture, region: tuple[int, int, int, int], noise: float, camera: Camera, settings: AngleSettings
) -> Evidence:
    """Fit the body edge; angle in the undistorted picture, from x towards y.

    Raises
    ------
    Refused
        There is no such edge or too little of it.
    """
    left, top, right, bottom = region
    seed = find_seed(picture[top:bottom, left:right], noise, settings)
    reach = clip_to(seed, right - left, bottom - top) if seed is not None else None
    if seed is None or reach is None:
        raise Refused(Reason.NO_EDGE, f"no {settings.edge} edge of a {settings.body} body in the region")
    finder = settings.finder
    along = np.arange(reach[0], reach[1], finder.spacing_px)
    tangent = np.array([-seed.normal[1], seed.normal[0]])
    centres = seed.point + np.array([left, top]) + along[:, None] * tangent
    normals = np.broadcast_to(seed.normal, centres.shape)
    found = find_points(picture, centres, normals, noise, finder, finder.search_px)
    line, _ = _line_through(found, camera, settings)
    centres, normals = _normals_of(line, found, seed.normal, camera, finder)
    inside = _inside(centres, region)
    found = find_points(
        picture, centres[inside], normals[inside], noise, finder, max(3.0, finder.search_px / 2)
    )
    found = _without_ends(found, finder.end_margin)
    line, ideal = _line_through(found, camera, settings)
    return _evidence(line, ideal, found, noise, camera)


def _line_through(found: EdgePoints, camera: Camera, settings: AngleSettings) -> tuple[Line, Array]:
    least = settings.quality.points
    if len(found.slots) < least:
        raise Refused(Reason.FEW_POINTS, f"{len(found.slots)} edge points found, at least {least} needed")
    ideal = camera.ideal(found.points)
    if not np.isfinite(ideal).all():
        raise Refused(Reason.LENS, "edge points lie where the lens model has no inverse")
    return fit_line(ideal, found.slots, found.std, _neighbours(settings.finder)), ideal


@lru_cache(maxsize=8)
def _neighbours(finder: Finder) -> Array:
    """Correlation of points on parallel normals, mean over the directions a line may have among pixels."""
    along = sample_offsets(finder.gradient_sigma_px)
    aside = np.arange(finder.average) - (finder.average - 1) / 2
    lags = max(1, int(np.ceil((finder.average + 3) / finder.spacing_px)))
    place = np.arange(lags + 1) * finder.spacing_px
    total = np.zeros(lags)
    directions = np.deg2rad([2.0, 12.0, 22.0, 32.0, 42.0])
    for angle in directions:
        tangent, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        sideways = place[:, None, None, None] + aside[None, None, :, None]
        rays = sideways * tangent + along[None, :, None, None] * normal
        total += neighbour_correlation(rays, finder.gradient_sigma_px)
    return total / len(directions)


def _normals_of(
    line: Line, found: EdgePoints, bright: Array, camera: Camera, finder: Finder
) -> tuple[Array, Array]:
    """Follow the straight line in the recorded, bent picture: pixels and unit normals, (m, 2) each."""
    ideal = camera.ideal(found.points)
    along = (ideal - line.centre) @ line.direction
    on_line = along[line.weights > 0]
    margin = 2 * finder.spacing_px
    places = np.arange(on_line.min() - margin, on_line.max() + margin, finder.spacing_px)
    step = 0.5
    ahead = camera.recorded(line.centre + (places[:, None] + step) * line.direction)
    behind = camera.recorded(line.centre + (places[:, None] - step) * line.direction)
    tangents = ahead - behind
    tangents = tangents / np.hypot(tangents[:, 0], tangents[:, 1])[:, None]
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    side = np.sign(normals @ bright)
    return 0.5 * (ahead + behind), normals * np.where(side == 0, 1.0, side)[:, None]


def _inside(points: Array, region: tuple[int, int, int, int]) -> NDArray[np.bool_]:
    left, top, right, bottom = region
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= left) & (x <= right - 1) & (y >= top) & (y <= bottom - 1))


def _without_ends(found: EdgePoints, margin: int) -> EdgePoints:
    # Where the body ends, the edge bends away over a few pixels; those points have the longest lever.
    if not margin or len(found.slots) <= 2 * margin:
        return found
    first, last = found.slots[0] + margin, found.slots[-1] - margin
    keep = (found.slots >= first) & (found.slots <= last)
    return subset(found, keep)


def _evidence(line: Line, ideal: Array, found: EdgePoints, noise: float, camera: Camera) -> Evidence:
    used = line.weights > 0
    along = (ideal - line.centre) @ line.direction
    span = float(np.ptp(along[used]))
    ends = line.centre + np.array([along[used].min(), along[used].max()])[:, None] * line.direction
    pieces = np.linspace(0, 1, 17)[:, None]
    return Evidence(
        angle=line.angle,
        std=line.angle_std,
        points=found.points,
        weights=line.weights,
        line=camera.recorded(ends[0] + pieces * (ends[1] - ends[0])),
        span=span,
        scatter=line.scale,
        contrast=float(np.median(found.contrast[used])),
        blur=float(np.median(found.blur[used])),
        noise=noise,
        correlation=line.correlation,
    )
