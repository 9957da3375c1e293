# SPDX-License-Identifier: Apache-2.0
"""A picture of what was measured: region, edge points, line, angle with standard error, or the refusal."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_rig.angle.frames import Frame, Grey
from cwmav_rig.angle.measure import FrameAngle
from cwmav_rig.angle.settings import AngleSettings

Colour = tuple[int, int, int]  # blue, green, red, as OpenCV wants them
_LINE, _USED, _OUTLIER, _REGION = (0, 140, 255), (80, 200, 0), (60, 60, 255), (255, 160, 0)
_FRACTION = 4  # bits behind the point in OpenCV's coordinates: lines are drawn to 1/16 px


def draw_overlay(frame: Frame, result: FrameAngle, settings: AngleSettings) -> NDArray[np.uint8]:
    """Draw the result into a colour copy of the frame, (rows, columns, 3), blue green red.

    A frame without a readable picture gives a grey card with the reason.
    """
    canvas = _canvas(frame.picture)
    if frame.picture is not None:
        left, top, right, bottom = settings.region.within(frame.picture.shape)
        cv2.rectangle(canvas, (left, top), (right - 1, bottom - 1), _REGION, 1)
    evidence = result.evidence
    if evidence is not None:
        for point, weight in zip(evidence.points, evidence.weights, strict=True):
            colour = _USED if weight > 0 else _OUTLIER
            cv2.circle(canvas, _fixed(point), 2 << _FRACTION, colour, 1, cv2.LINE_AA, _FRACTION)
        line = np.array([_fixed(point) for point in evidence.line], dtype=np.int32)
        cv2.polylines(canvas, [line.reshape(-1, 1, 2)], False, _LINE, 1, cv2.LINE_AA, _FRACTION)
    _write(canvas, _caption(frame, result))
    return np.asarray(canvas, dtype=np.uint8)


def save_overlay(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write an overlay as PNG.

    Raises
    ------
    WorkError
        The file cannot be written.
    """
    done, data = cv2.imencode(".png", picture)
    try:
        if not done:
            raise OSError("PNG encoding failed")
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise WorkError(f"{path}: cannot be written ({error})") from None


def encode_jpeg(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Compress an overlay for a recording, (bytes,)."""
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
    if not done:
        raise WorkError("an overlay cannot be compressed as JPEG")
    return np.asarray(data, dtype=np.uint8).ravel()


def _canvas(picture: Grey | None) -> Any:
    if picture is None:
        return np.full((240, 640, 3), 96, np.uint8)
    levels: Any = picture
    if picture.dtype == np.uint16:
        largest = max(int(picture.max()), 1)
        levels = (picture.astype(np.float32) * (255.0 / largest)).astype(np.uint8)
    return cv2.cvtColor(np.ascontiguousarray(levels), cv2.COLOR_GRAY2BGR)


def _fixed(point: NDArray[np.float64]) -> tuple[int, int]:
    scaled = np.rint(np.clip(point, -1e6, 1e6) * (1 << _FRACTION))
    return int(scaled[0]), int(scaled[1])


def _caption(frame: Frame, result: FrameAngle) -> Iterable[str]:
    seconds, rest = divmod(frame.stamp_ns, 1_000_000_000)
    yield f"frame {frame.index}   t {seconds}.{rest:09d}"
    if result.measured:
        yield f"AoA {np.rad2deg(result.angle):.3f} +- {np.rad2deg(result.std):.3f} deg"
    else:
        yield f"refused: {result.reason}"
        yield result.text


def _write(canvas: Any, lines: Iterable[str]) -> None:
    """Write lines onto a darkened strip at the top; the strip is in the overlay only."""
    texts = list(lines)
    scale = float(np.clip(canvas.shape[1] / 900.0, 0.35, 1.5))
    row = round(30 * scale)
    strip = canvas[: row * len(texts) + row // 3]
    strip[:] = strip // 4
    for number, text in enumerate(texts):
        place = (6, (number + 1) * row)
        cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
