# SPDX-License-Identifier: Apache-2.0
"""One frame in, one angle of attack with its standard error out, or the reason why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_rig.angle.camera_model import Camera, PlainCamera
from cwmav_rig.angle.coarse import edge_angle
from cwmav_rig.angle.edge import measure_edge
from cwmav_rig.angle.evidence import Evidence, Reason, Refused
from cwmav_rig.angle.frames import Frame, Grey
from cwmav_rig.angle.markers import measure_markers
from cwmav_rig.angle.sampling import noise_level
from cwmav_rig.angle.settings import AngleSettings


@dataclass(frozen=True)
class FrameAngle:
    """Result of one frame.

    Attributes
    ----------
    index, stamp_ns
        Of the frame.
    angle, std
        Angle of attack [rad], nose up positive, and its standard error; NaN when refused.
    reason, text
        Why it was refused; None and empty when it was not.
    evidence
        What was seen, as far as the measurement came.
    """

    index: int
    stamp_ns: int
    angle: float
    std: float
    reason: Reason | None
    text: str
    evidence: Evidence | None

    @property
    def measured(self) -> bool:
        """True when there is an angle."""
        return self.reason is None


def measure_frame(
    frame: Frame, settings: AngleSettings, camera: Camera | None = None, previous: Grey | None = None
) -> FrameAngle:
    """Measure the angle of attack in one frame.

    Parameters
    ----------
    camera
        The lens; without it the picture is taken as undistorted.
    previous
        Picture of the frame before, to recognise that the camera sent it twice.

    Raises
    ------
    InputError
        The settings or the calibration do not fit the size of the picture.
    """
    lens = camera or PlainCamera(settings.pixel_aspect)
    evidence: Evidence | None = None
    try:
        picture = _readable(frame, settings, previous)
        lens.check(picture.shape, frame.name)
        region = settings.region.within(picture.shape)
        part = picture[region[1] : region[3], region[0] : region[2]]
        _not_saturated(part, settings)
        levels = picture.astype(np.float32)
        noise = noise_level(levels[region[1] : region[3], region[0] : region[2]])
        method = measure_edge if settings.method == "edge" else measure_markers
        evidence = method(levels, region, noise, lens, settings)
        angle = angle_of_attack(evidence.angle, settings)
        _good_enough(evidence, angle, settings)
    except Refused as refusal:
        nothing = float("nan")
        return FrameAngle(
            frame.index, frame.stamp_ns, nothing, nothing, refusal.reason, str(refusal), evidence
        )
    return FrameAngle(frame.index, frame.stamp_ns, angle, evidence.std, None, "", evidence)


def angle_of_attack(line_angle: float, settings: AngleSettings) -> float:
    """Turn the direction of the line in the picture [rad, x towards y] into the angle of attack [rad].

    y points down in a picture, so a line that rises to the right has a negative direction: nose up for a nose
    at the right. Roll and edge angle are subtracted, and the result is taken between -pi/2 and pi/2.
    """
    shown = float(edge_angle(np.array(line_angle - np.pi / 2), settings))
    return float((shown - settings.correction + np.pi / 2) % np.pi - np.pi / 2)


def _readable(frame: Frame, settings: AngleSettings, previous: Grey | None) -> Grey:
    if frame.picture is None:
        raise Refused(Reason.UNREADABLE, frame.problem)
    if settings.quality.identical and previous is not None and np.array_equal(previous, frame.picture):
        raise Refused(Reason.REPEATED, "equal pixel by pixel to the frame before")
    return frame.picture


def _not_saturated(part: Grey, settings: AngleSettings) -> None:
    quality = settings.quality
    level = quality.saturation_level or int(np.iinfo(part.dtype).max)
    share = np.count_nonzero(part >= level) / part.size
    if share > quality.saturated_fraction:
        raise Refused(
            Reason.SATURATED,
            f"{100 * share:.1f} % of the region at grey level {level} or above, "
            f"at most {100 * quality.saturated_fraction:g} % allowed",
        )


def _good_enough(evidence: Evidence, angle: float, settings: AngleSettings) -> None:
    quality = settings.quality
    used = int((evidence.weights > 0).sum())
    share = used / len(evidence.weights)
    snr = evidence.contrast / evidence.noise
    std_deg = float(np.rad2deg(evidence.std))
    if settings.method == "edge" and used < quality.points:
        raise Refused(Reason.FEW_POINTS, f"{used} points on the line, at least {quality.points} needed")
    if share < quality.inlier_fraction:
        raise Refused(
            Reason.FEW_POINTS,
            f"{100 * share:.0f} % of the points on the line, "
            f"at least {100 * quality.inlier_fraction:g} % needed",
        )
    if snr < quality.contrast_to_noise:
        raise Refused(
            Reason.LOW_CONTRAST,
            f"contrast {evidence.contrast:.1f} is {snr:.1f} times the noise, "
            f"at least {quality.contrast_to_noise:g} needed",
        )
    if evidence.blur > quality.blur_px:
        raise Refused(
            Reason.BLURRED, f"edge spread {evidence.blur:.1f} px, at most {quality.blur_px:g} allowed"
        )
    if evidence.span < quality.span_px:
        raise Refused(Reason.SHORT, f"line of {evidence.span:.0f} px, at least {quality.span_px:g} needed")
    if evidence.scatter > quality.residual_px:
        raise Refused(
            Reason.NOT_STRAIGHT,
            f"points scatter {evidence.scatter:.2f} px about the fit, "
            f"at most {quality.residual_px:g} allowed",
        )
    if not settings.angle_min_deg <= np.rad2deg(angle) <= settings.angle_max_deg:
        raise Refused(
            Reason.RANGE,
            f"angle {np.rad2deg(angle):.2f} deg, "
            f"allowed {settings.angle_min_deg:g} to {settings.angle_max_deg:g}",
        )
    if not std_deg <= quality.std_deg:
        raise Refused(
            Reason.UNCERTAIN, f"standard error {std_deg:.2f} deg, at most {quality.std_deg:g} allowed"
        )
