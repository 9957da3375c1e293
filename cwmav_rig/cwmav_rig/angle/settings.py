# SPDX-License-Identifier: Apache-2.0
"""What a person tells the angle measurement about the camera, the picture and how bad a frame may be."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cwmav_common.errors import InputError
from cwmav_common.settings import setting


@dataclass(frozen=True)
class Region:
    """Region of interest in pixels of the recorded picture; everything outside is ignored."""

    x: int = setting(0, "left column", unit="px", ge=0)
    y: int = setting(0, "top row", unit="px", ge=0)
    width: int = setting(0, "columns; 0 is up to the right border", unit="px", ge=0)
    height: int = setting(0, "rows; 0 is down to the lower border", unit="px", ge=0)

    def within(self, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
        """Give (left, top, right, bottom), the last two exclusive, inside a picture of `shape`.

        Raises
        ------
        InputError
            The region does not lie in the picture or is less than 16 pixels wide or high.
        """
        rows, columns = shape[:2]
        right = self.x + self.width if self.width else columns
        bottom = self.y + self.height if self.height else rows
        if right > columns or bottom > rows or right - self.x < 16 or bottom - self.y < 16:
            raise InputError(
                f"region x={self.x} y={self.y} width={self.width} height={self.height} does not fit: "
                f"pictures are {columns} x {rows} pixels, a region is inside and at least 16 x 16"
            )
        return self.x, self.y, right, bottom


@dataclass(frozen=True)
class Finder:
    """How edge points are found along normals."""

    search_px: float = setting(12.0, "reach on either side of the first guess", unit="px", ge=3, le=100)
    spacing_px: float = setting(
        4.0, "distance between normals; far enough apart for independent noise", unit="px", ge=1, le=50
    )
    average: int = setting(3, "parallel profiles, one pixel apart, averaged at each normal", ge=1, le=15)
    gradient_sigma_px: float = setting(
        1.5, "width of the Gaussian whose derivative finds the edge", unit="px", ge=0.7, le=10
    )
    end_margin: int = setting(2, "normals left out at each end of the edge found", ge=0, le=50)


@dataclass(frozen=True)
class Markers:
    """The two marks on the body axis."""

    diameter_px: float = setting(16.0, "diameter in the picture", unit="px", ge=6, le=400)
    tolerance: float = setting(1.6, "largest ratio between found and stated diameter", ge=1.05, le=4)
    polarity: str = setting("bright", "against what surrounds them", choices=("bright", "dark"))

    @property
    def rays(self) -> int:
        """Directions in which the rim is looked for: two pixels apart, so that their noise is independent."""
        return max(16, round(np.pi * self.diameter_px / 2))


@dataclass(frozen=True)
class Quality:
    """Limits beyond which a frame is refused."""

    saturated_fraction: float = setting(0.05, "share of saturated pixels in the region", ge=0, le=1)
    saturation_level: int = setting(
        0, "grey level that counts as saturated; 0 is the largest of the pixel type", ge=0, le=65535
    )
    blur_px: float = setting(6.0, "standard deviation of the edge spread", unit="px", gt=0)
    contrast_to_noise: float = setting(5.0, "least step across the edge over the noise of a pixel", gt=0)
    points: int = setting(
        25, "fewest points on the line (for markers: two thirds of the rays, on each rim)", ge=5
    )
    span_px: float = setting(60.0, "shortest line or marker distance", unit="px", gt=0)
    inlier_fraction: float = setting(0.5, "least share of found points that lie on the line", ge=0, le=1)
    residual_px: float = setting(1.0, "largest scatter of the points about the line", unit="px", gt=0)
    std_deg: float = setting(1.0, "largest standard error of the angle", unit="deg", gt=0)
    identical: bool = setting(
        True, "refuse a frame equal pixel by pixel to the one before: the camera repeated it"
    )
    refused_fraction: float = setting(
        0.1, "share of refused frames above which statistics are refused", ge=0, le=1
    )


@dataclass(frozen=True)
class AngleSettings:
    """Everything about the measurement except the lens, which a CameraInfo describes.

    Angles are counted nose up positive. `camera_roll_deg` and `edge_to_axis_deg` are corrections with their
    standard uncertainties; those act on all frames alike, so they are kept apart from the error of a frame.
    """

    method: str = setting("edge", "what carries the direction of the body", choices=("edge", "markers"))
    nose: str = setting(
        "right", "side of the picture the nose points to, against the wind", choices=("left", "right")
    )
    body: str = setting("dark", "body against its background", choices=("dark", "bright"))
    edge: str = setting("upper", "which edge of the body", choices=("upper", "lower", "strongest"))
    camera_roll_deg: float = setting(
        0.0,
        "rotation of the camera about its axis, clockwise seen from behind it",
        unit="deg",
        ge=-180,
        le=180,
    )
    camera_roll_std_deg: float = setting(0.0, "standard uncertainty of the roll", unit="deg", ge=0)
    edge_to_axis_deg: float = setting(
        0.0, "angle of the edge (or marker line) against the body axis, nose up", unit="deg", ge=-90, le=90
    )
    edge_to_axis_std_deg: float = setting(0.0, "standard uncertainty of that angle", unit="deg", ge=0)
    angle_min_deg: float = setting(-35.0, "least angle of attack looked for", unit="deg", ge=-89, le=89)
    angle_max_deg: float = setting(80.0, "largest angle of attack looked for", unit="deg", ge=-89, le=89)
    pixel_aspect: float = setting(1.0, "height over width of a pixel, without a CameraInfo", gt=0.1, lt=10)
    region: Region = field(default_factory=Region)
    finder: Finder = field(default_factory=Finder)
    markers: Markers = field(default_factory=Markers)
    quality: Quality = field(default_factory=Quality)

    def __post_init__(self) -> None:
        if self.angle_min_deg >= self.angle_max_deg:
            raise InputError(
                f"angle_min_deg {self.angle_min_deg:g} is not below angle_max_deg {self.angle_max_deg:g}"
            )

    @property
    def correction(self) -> float:
        """Angle of the edge in the picture at zero angle of attack [rad]."""
        # A camera turned clockwise shows the scene turned counter-clockwise, which is nose up for a nose at
        # the right and nose down for one at the left.
        roll = self.camera_roll_deg if self.nose == "right" else -self.camera_roll_deg
        return float(np.deg2rad(roll + self.edge_to_axis_deg))

    @property
    def systematic_std(self) -> float:
        """Standard uncertainty common to all frames [rad]: roll and edge angle in quadrature."""
        return float(np.deg2rad(np.hypot(self.camera_roll_std_deg, self.edge_to_axis_std_deg)))
