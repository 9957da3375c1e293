# SPDX-License-Identifier: Apache-2.0
"""The lens: from recorded pixels to the undistorted picture and back.

Only points are undistorted, never pictures: interpolating a picture smears the noise that the standard error
is computed from. Models and parameters are those of ``sensor_msgs/CameraInfo`` (``plumb_bob``: k1 k2 p1 p2
k3; ``rational_polynomial``: with k4 k5 k6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from cwmav_common.errors import InputError

Array = NDArray[np.float64]

_COEFFICIENTS = {"plumb_bob": 5, "rational_polynomial": 8}
_ITERATIONS = 60


@dataclass(frozen=True)
class PlainCamera:
    """No calibration: the picture is taken as it is, apart from pixels that are not square."""

    aspect: float = 1.0

    def ideal(self, points: Array) -> Array:
        """Undistort recorded pixels, (n, 2) -> (n, 2)."""
        return np.asarray(points * np.array([1.0, self.aspect]))

    def recorded(self, points: Array) -> Array:
        """Give the recorded pixels of undistorted points, (n, 2) -> (n, 2)."""
        return np.asarray(points / np.array([1.0, self.aspect]))

    def check(self, shape: tuple[int, ...], source: str) -> None:
        """Accept every picture size."""


@dataclass(frozen=True)
class CalibratedCamera:
    """A lens with distortion.

    Attributes
    ----------
    width, height
        Size of the pictures [px], after binning and region of interest.
    matrix
        (3, 3) intrinsic matrix K for the full sensor.
    distortion
        (8,) k1 k2 p1 p2 k3 k4 k5 k6.
    rotation
        (3, 3) rectification R; turns the camera in software, for example onto the plane of the body.
    binning, offset
        (2,) each: recorded pixel u is full-sensor pixel ``binning * (u + 1/2) - 1/2 + offset``.
    """

    width: int
    height: int
    matrix: Array
    distortion: Array
    rotation: Array
    binning: Array
    offset: Array
    source: str = "CameraInfo"

    @property
    def focal(self) -> float:
        """Focal length that scales undistorted points, so that they are about as large as pixels [px]."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]) / self.binning[0])

    def ideal(self, points: Array) -> Array:
        """Undistort recorded pixels, (n, 2) -> (n, 2).

        Axes as in the picture, pixels square, origin on the optical axis. NaN where the lens model has no
        inverse, which happens far outside of the calibrated field.
        """
        full = self.binning * (points + 0.5) - 0.5 + self.offset
        y = (full[:, 1] - self.matrix[1, 2]) / self.matrix[1, 1]
        x = (full[:, 0] - self.matrix[0, 2] - self.matrix[0, 1] * y) / self.matrix[0, 0]
        plain = self._undistort(np.column_stack([x, y]))
        rays = np.column_stack([plain, np.ones(len(plain))]) @ self.rotation.T
        return rays[:, :2] / rays[:, 2:] * self.focal

    def recorded(self, points: Array) -> Array:
        """Give the recorded pixels of undistorted points, (n, 2) -> (n, 2)."""
        rays = np.column_stack([points / self.focal, np.ones(len(points))]) @ self.rotation
        bent = _distort(rays[:, :2] / rays[:, 2:], self.distortion)
        u = self.matrix[0, 0] * bent[:, 0] + self.matrix[0, 1] * bent[:, 1] + self.matrix[0, 2]
        v = self.matrix[1, 1] * bent[:, 1] + self.matrix[1, 2]
        return (np.column_stack([u, v]) - self.offset + 0.5) / self.binning - 0.5

    def check(self, shape: tuple[int, ...], source: str) -> None:
        """Raise InputError when pictures of `shape` are not those the calibration is for."""
        if shape[:2] != (self.height, self.width):
            raise InputError(
                f"{source}: picture is {shape[1]} x {shape[0]} pixels, {self.source} describes "
                f"{self.width} x {self.height}"
            )

    def _undistort(self, bent: Array) -> Array:
        """Newton's method on the forward model."""
        plain = bent.copy()
        for _ in range(_ITERATIONS):
            error = _distort(plain, self.distortion) - bent
            a, b, c, d = _jacobian(plain, self.distortion)
            determinant = a * d - b * c
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.column_stack(
                    [(d * error[:, 0] - b * error[:, 1]), (a * error[:, 1] - c * error[:, 0])]
                )
                step = step / determinant[:, None]
            # Beyond the fold of the model the Jacobian is not positive: no step leads back from there.
            plain = np.where((determinant > 0)[:, None], plain - step, np.nan)
            if not np.any(np.abs(step[np.isfinite(plain).all(axis=1)]) > 1e-13):
                break
        error = np.abs(_distort(plain, self.distortion) - bent).max(axis=1)
        plain[~(error < 1e-9)] = np.nan
        return plain


Camera = PlainCamera | CalibratedCamera


def from_camera_info(message: Any, source: str) -> CalibratedCamera | None:
    """Make the camera of a ``sensor_msgs/CameraInfo`` message; None when it says it is not calibrated."""
    matrix = np.asarray(message.k, dtype=float).reshape(3, 3)
    if matrix[0, 0] == 0.0:  # the message definition's own sign for "uncalibrated"
        return None
    binning = (max(int(message.binning_x), 1), max(int(message.binning_y), 1))
    roi = message.roi
    partial = roi.width > 0 and roi.height > 0
    width, height = (roi.width, roi.height) if partial else (message.width, message.height)
    return calibrated(
        width=int(width) // binning[0],
        height=int(height) // binning[1],
        matrix=matrix,
        model=str(message.distortion_model),
        coefficients=[float(value) for value in message.d],
        rotation=np.asarray(message.r, dtype=float).reshape(3, 3),
        source=source,
        binning=binning,
        offset=(float(roi.x_offset), float(roi.y_offset)) if partial else (0.0, 0.0),
    )


def load_camera(path: str | Path) -> CalibratedCamera:
    """Read the YAML file that the ROS camera calibration writes.

    Raises
    ------
    InputError
        The file is missing, no such YAML, or describes a lens model that is not supported.
    """
    path = Path(path)
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        values = {
            name: [float(x) for x in content[name]["data"]]
            for name in ("camera_matrix", "distortion_coefficients")
        }
        rectification = content.get("rectification_matrix", {"data": np.eye(3).ravel().tolist()})
        return calibrated(
            width=int(content["image_width"]),
            height=int(content["image_height"]),
            matrix=np.array(values["camera_matrix"]).reshape(3, 3),
            model=str(content.get("distortion_model", content.get("camera_model", "plumb_bob"))),
            coefficients=values["distortion_coefficients"],
            rotation=np.array(rectification["data"], dtype=float).reshape(3, 3),
            source=str(path),
        )
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path}: is no camera calibration ({type(error).__name__}: {error}); expected image_width, "
            "image_height, camera_matrix, distortion_model and distortion_coefficients"
        ) from None


def calibrated(
    *,
    width: int,
    height: int,
    matrix: Array,
    model: str,
    coefficients: Sequence[float],
    rotation: Array | None = None,
    source: str = "CameraInfo",
    binning: tuple[float, float] = (1.0, 1.0),
    offset: tuple[float, float] = (0.0, 0.0),
) -> CalibratedCamera:
    """Make a camera from checked parameters; see :class:`CalibratedCamera`.

    Raises
    ------
    InputError
        Unknown lens model, wrong number of coefficients or numbers that describe no camera.
    """
    given = list(coefficients)
    if model == "" and not any(given):
        model = "plumb_bob"
    if model not in _COEFFICIENTS:
        raise InputError(f"{source}: distortion model {model!r}; allowed: {', '.join(_COEFFICIENTS)}")
    if len(given) > 8 and any(given[8:]):
        raise InputError(f"{source}: {len(given)} distortion coefficients; at most 8 are supported")
    distortion = np.zeros(8)
    distortion[: min(len(given), 8)] = given[:8]
    if any(distortion[_COEFFICIENTS[model] :]):
        raise InputError(f"{source}: {model} has {_COEFFICIENTS[model]} coefficients, {len(given)} given")
    turn = np.eye(3) if rotation is None or not np.any(rotation) else np.asarray(rotation, dtype=float)
    numbers = np.concatenate([matrix.ravel(), distortion, turn.ravel()])
    if not np.isfinite(numbers).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0 or min(width, height) < 1:
        raise InputError(
            f"{source}: size {width} x {height} and matrix {matrix.ravel().tolist()} are no camera"
        )
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-4):
        raise InputError(f"{source}: rectification matrix is no rotation")
    return CalibratedCamera(
        width, height, matrix, distortion, turn, np.array(binning), np.array(offset), source
    )


def _distort(plain: Array, d: Array) -> Array:
    x, y = plain[:, 0], plain[:, 1]
    r2 = x * x + y * y
    k1, k2, p1, p2, k3, k4, k5, k6 = d
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )


def _jacobian(plain: Array, d: Array) -> tuple[Array, Array, Array, Array]:
    """Give the derivatives (dx'/dx, dx'/dy, dy'/dx, dy'/dy) of :func:`_distort`, each (n,)."""
    x, y = plain[:, 0], plain[:, 1]
    r2 = x * x + y * y
    k1, k2, p1, p2, k3, k4, k5, k6 = d
    top = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    low = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = top / low
    slope = (k1 + r2 * (2 * k2 + 3 * r2 * k3) - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / low
    cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    return (
        radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
        cross,
        cross,
        radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )
