# SPDX-License-Identifier: Apache-2.0
"""What was seen in a frame, and why a frame was refused."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Reason(StrEnum):
    """Why a frame gives no angle."""

    UNREADABLE = "unreadable"
    REPEATED = "repeated"
    SATURATED = "saturated"
    NO_EDGE = "no_edge"
    FEW_POINTS = "few_points"
    MARKERS = "markers"
    BLURRED = "blurred"
    LOW_CONTRAST = "low_contrast"
    SHORT = "short"
    NOT_STRAIGHT = "not_straight"
    LENS = "lens"
    RANGE = "out_of_range"
    UNCERTAIN = "uncertain"


class Refused(Exception):  # noqa: N818 - an outcome of a measurement, not an error of the program
    """A frame gives no angle; `reason` is counted, the text says it with numbers."""

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(text)
        self.reason = reason


@dataclass(frozen=True)
class Evidence:
    """Geometry found in one frame and how well.

    Attributes
    ----------
    angle, std
        Direction of the line in the undistorted picture, from x towards y, and its standard error [rad].
    points
        (n, 2) edge points in recorded pixels.
    weights
        (n,) their weights in the fit, 0 to 1.
    line
        (m, 2) the fitted line in recorded pixels.
    span
        Length of the line that carries points [px].
    scatter
        Standard deviation of the points about the fit [px].
    contrast, noise
        Step across the edge and standard deviation of a pixel [grey levels].
    blur
        Standard deviation of the spread of the edge [px].
    correlation
        Factor by which correlated neighbours enlarged the variance of the angle.
    """

    angle: float
    std: float
    points: Array
    weights: Array
    line: Array
    span: float
    scatter: float
    contrast: float
    blur: float
    noise: float
    correlation: float
