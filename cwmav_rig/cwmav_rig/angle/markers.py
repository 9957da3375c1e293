# SPDX-License-Identifier: Apache-2.0
"""The two round marks on the body axis: found as blobs, centred by their rims, joined by a line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from cwmav_rig.angle import settings as settings_module
from cwmav_rig.angle.camera_model import Camera
from cwmav_rig.angle.edge import EdgePoints, find_points
from cwmav_rig.angle.evidence import Evidence, Reason, Refused
from cwmav_rig.angle.robust import Fit, estimate, fit_linear
from cwmav_rig.angle.sampling import Picture, neighbour_correlation, sample_offsets
from cwmav_rig.angle.settings import AngleSettings

Array = NDArray[np.float64]

_CANDIDATES = 12
_RIM_SHARE = 2 / 3  # of the rays that must meet the rim
_CIRCLE_SCATTER = 0.08  # of the radius; a rim that scatters more belongs to something else


@dataclass(frozen=True)
class Marker:
    """One mark: centre in undistorted pixels with covariance (2, 2), mean radius, rim points, fit."""

    centre: Array
    covariance: Array
    radius: float
    rim: EdgePoints
    fit: Fit


def measure_markers(
    picture: Picture, region: tuple[int, int, int, int], noise: float, camera: Camera, settings: AngleSettings
) -> Evidence:
    """Join the two marks; angle in the undistorted picture, from x towards y.

    Raises
    ------
    Refused
        There are not exactly two marks of the stated size in the region.
    """
    found: list[Marker] = []
    for candidate in _candidates(picture, region, noise, settings.markers):
        marker = _marker_at(picture, candidate, noise, camera, settings)
        if marker is not None and all(
            np.hypot(*(marker.centre - other.centre)) > marker.radius for other in found
        ):
            found.append(marker)
    if len(found) != 2:
        wanted = settings.markers
        raise Refused(
            Reason.MARKERS,
            f"{len(found)} {wanted.polarity} marks of {wanted.diameter_px:g} px in the region, 2 needed",
        )
    return _evidence(found[0], found[1], noise, camera)


def _candidates(
    picture: Picture, region: tuple[int, int, int, int], noise: float, markers: settings_module.Markers
) -> list[Array]:
    """Give the strongest maxima of a difference of Gaussians of the size of a mark, recorded pixels."""
    left, top, right, bottom = region
    radius = markers.diameter_px / 2
    shrink = max(1, int(radius // 4))
    part = picture[top:bottom, left:right]
    if shrink > 1:
        size = (max(8, part.shape[1] // shrink), max(8, part.shape[0] // shrink))
        part = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    scale = np.array([(right - left) / part.shape[1], (bottom - top) / part.shape[0]])
    inner = 0.7 * radius / float(scale.mean())
    response = cv2.GaussianBlur(part, (0, 0), inner) - cv2.GaussianBlur(part, (0, 0), 1.6 * inner)
    if markers.polarity == "dark":
        response = -response
    response = np.asarray(response)
    width = 2 * int(np.ceil(inner)) + 1
    highest = cv2.dilate(response, np.ones((width, width), np.uint8))
    rows, columns = np.nonzero((response >= highest) & (response > noise / inner))
    order = np.argsort(-response[rows, columns], kind="stable")[:_CANDIDATES]
    places = np.column_stack([columns[order], rows[order]])
    return list((places + 0.5) * scale - 0.5 + np.array([left, top]))


def _marker_at(
    picture: Picture, place: Array, noise: float, camera: Camera, settings: AngleSettings
) -> Marker | None:
    """Fit the rim around `place`, centred anew each time; None when it is not round or not of the size."""
    markers = settings.markers
    finder = replace(settings.finder, average=1)
    expected = markers.diameter_px / 2
    radius, reach = expected, expected * (markers.tolerance - 1) + 2.0
    marker: Marker | None = None
    for _ in range(4):
        rim = _rim(picture, place, radius, reach, noise, finder, markers)
        if len(rim.slots) < _RIM_SHARE * markers.rays:
            return None
        marker = _fit_rim(
            rim,
            camera,
            markers.rays,
            _neighbours_of(round(2 * radius) / 2, markers.rays, finder.gradient_sigma_px),
        )
        if marker is None:
            return None
        moved = camera.recorded(marker.centre[None, :])[0]
        if not np.isfinite(moved).all() or np.hypot(*(moved - place)) > expected:
            return None
        settled = np.hypot(*(moved - place)) < 0.05
        place, radius, reach = moved, _mean_radius(rim, moved), max(3.0, 0.35 * expected)
        if settled:
            break
    if marker is None or not expected / markers.tolerance <= radius <= expected * markers.tolerance:
        return None
    used = int((marker.fit.weights > 0).sum())
    allowed = max(1.0, _CIRCLE_SCATTER * radius)
    return marker if used >= _RIM_SHARE * markers.rays and marker.fit.scale <= allowed else None


def _rim(
    picture: Picture,
    place: Array,
    radius: float,
    reach: float,
    noise: float,
    finder: settings_module.Finder,
    markers: settings_module.Markers,
) -> EdgePoints:
    turn = 2 * np.pi * np.arange(markers.rays) / markers.rays
    outward = np.column_stack([np.cos(turn), np.sin(turn)])
    bright = outward if markers.polarity == "dark" else -outward
    # A ray must not look past the centre, where the opposite rim begins.
    return find_points(picture, place + radius * outward, bright, noise, finder, min(reach, 0.9 * radius))


def _mean_radius(rim: EdgePoints, place: Array) -> float:
    return float(np.median(np.hypot(*(rim.points - place).T)))


def _fit_rim(rim: EdgePoints, camera: Camera, rays: int, neighbours: Array) -> Marker | None:
    """Fit ``r(phi) = r0 + cx cos(phi) + cy sin(phi) + a cos(2 phi) + b sin(2 phi)`` about the middle.

    The first harmonic is the shift of the centre; the second takes up perspective and motion blur, which make
    a circle oblong without moving its centre.
    """
    ideal = camera.ideal(rim.points)
    if not np.isfinite(ideal).all():
        return None
    origin = _middle(ideal)
    start = np.array([float(np.median(np.hypot(*(ideal - origin).T))), 0.0, 0.0, 0.0, 0.0])
    relative = rim.std / np.median(rim.std)
    for _ in range(10):
        design, radius = _harmonics(ideal - origin, relative)
        coefficients, _ = estimate(design, radius, start)
        origin = origin + coefficients[1:3]
        start = coefficients * np.array([1, 0, 0, 1, 1])
        if np.hypot(*coefficients[1:3]) < 1e-7:
            break
    design, radius = _harmonics(ideal - origin, relative)
    fit = fit_linear(design, radius, rim.slots, start, neighbours=neighbours, ring=rays)
    return Marker(origin + fit.coefficients[1:3], fit.covariance[1:3, 1:3], float(start[0]), rim, fit)


@lru_cache(maxsize=64)
def _neighbours_of(radius: float, rays: int, sigma: float) -> Array:
    """Correlation of points on neighbouring rays, mean over the directions in the pixel grid."""
    along = sample_offsets(sigma)
    turn = 2 * np.pi / rays
    lags = max(1, min(rays // 2, int(np.ceil(4.0 / (radius * turn)))))
    total = np.zeros(lags)
    first = np.deg2rad([2.0, 12.0, 22.0, 32.0, 42.0])
    for angle in first:
        phi = angle + turn * np.arange(lags + 1)
        outward = np.column_stack([np.cos(phi), np.sin(phi)])
        points = (radius + along)[None, :, None] * outward[:, None, :]
        total += neighbour_correlation(points[:, :, None, :], sigma)
    return total / len(first)


def _harmonics(shifted: Array, relative: Array) -> tuple[Array, Array]:
    """Give the design (n, 5) and the radii (n,), both over the relative standard deviation of each point."""
    phi = np.arctan2(shifted[:, 1], shifted[:, 0])
    columns = [np.ones(len(phi)), np.cos(phi), np.sin(phi), np.cos(2 * phi), np.sin(2 * phi)]
    return np.column_stack(columns) / relative[:, None], np.hypot(shifted[:, 0], shifted[:, 1]) / relative


def _middle(points: Array) -> Array:
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _evidence(first: Marker, second: Marker, noise: float, camera: Camera) -> Evidence:
    step = second.centre - first.centre
    length = float(np.hypot(*step))
    across = np.array([-step[1], step[0]]) / length
    variance = across @ (first.covariance + second.covariance) @ across / length**2
    angle = (np.arctan2(step[1], step[0]) + np.pi / 2) % np.pi - np.pi / 2
    both = (first, second)
    pieces = np.linspace(0, 1, 17)[:, None]
    return Evidence(
        angle=float(angle),
        std=float(np.sqrt(variance)),
        points=np.vstack([marker.rim.points for marker in both]),
        weights=np.concatenate([marker.fit.weights for marker in both]),
        line=camera.recorded(first.centre + pieces * step),
        span=length,
        scatter=max(marker.fit.scale for marker in both),
        contrast=min(float(np.median(marker.rim.contrast)) for marker in both),
        blur=max(float(np.median(marker.rim.blur)) for marker in both),
        noise=noise,
        correlation=max(marker.fit.correlation for marker in both),
    )
