# SPDX-License-Identifier: Apache-2.0
"""What the measurement leaves behind: a table, a recording for viewers and analysis, overlay pictures."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from cwmav_common import interfaces
from cwmav_common.errors import InputError, WorkError
from cwmav_common.mcap_writer import BagWriter
from cwmav_common.settings import to_mapping
from cwmav_rig.angle.frames import COMPRESSED, Frame
from cwmav_rig.angle.measure import FrameAngle
from cwmav_rig.angle.overlay import draw_overlay, encode_jpeg, save_overlay
from cwmav_rig.angle.settings import AngleSettings
from cwmav_rig.angle.stream import QUALITIES, AngleStream

SCALAR = "cwmav_msgs/msg/ScalarStamped"
ANGLE_TOPIC = "/camera/angle_of_attack"
OVERLAY_TOPIC = "/camera/angle_of_attack/overlay/compressed"


def write_table(path: str | Path, stream: AngleStream) -> None:
    """Write one line per frame, refused ones with their reason, as CSV (angles in rad).

    Raises
    ------
    WorkError
        The file cannot be written.
    """
    refusals = {refusal.index: refusal for refusal in stream.refusals}
    header = ["frame", "stamp_ns", "angle_rad", "std_rad", "points", *QUALITIES, "refused", "why"]
    try:
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(header)
            for index, stamp in enumerate(stream.stamps_ns.tolist()):
                qualities = [_number(stream.quality[name][index]) for name in QUALITIES]
                refusal = refusals.get(index)
                why = [refusal.reason, refusal.text] if refusal else ["", ""]
                numbers = [_number(stream.angle[index]), _number(stream.std[index])]
                table.writerow([index, stamp, *numbers, int(stream.points[index]), *qualities, *why])
    except OSError as error:
        raise WorkError(f"{path}: cannot be written ({error.strerror or error})") from None


def _number(value: float) -> str:
    return f"{value:.9g}" if np.isfinite(value) else ""


class Outputs:
    """Writes overlays and the recording while frames pass by; nothing is kept in memory.

    Parameters
    ----------
    settings
        Of the measurement; stored in the recording.
    overlays
        Folder for PNG overlays, or None.
    recording
        MCAP file with angle and overlay topics, or None.
    every
        Overlay of each n-th frame; refused frames always get one.
    synthetic
        The frames come from the simulated camera; the recording says so.
    """

    def __init__(
        self,
        settings: AngleSettings,
        overlays: Path | None = None,
        recording: Path | None = None,
        every: int = 1,
        *,
        synthetic: bool = False,
    ) -> None:
        if every < 1:
            raise InputError(f"every {every}; allowed: 1 or more")
        self.settings = settings
        self.every = every
        self.count = 0
        self._folder = overlays
        if overlays is not None:
            try:
                overlays.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{overlays}: cannot be made ({error.strerror or error})") from None
        self._writer = BagWriter(recording) if recording is not None else None
        if self._writer is not None:
            self._writer.add_topic(ANGLE_TOPIC, SCALAR)
            values = {"settings": json.dumps(to_mapping(settings)), "synthetic": str(synthetic).lower()}
            self._writer.add_metadata("cwmav_angle", values)
            topic_map = {"angle_of_attack": {"topic": ANGLE_TOPIC}}
            self._writer.add_metadata("cwmav", {"topic_map": json.dumps(topic_map)})

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Finish the recording."""
        if self._writer is not None:
            self._writer.close()

    def take(self, frame: Frame, result: FrameAngle) -> None:
        """Write what is wanted of one frame."""
        if self._writer is not None and result.measured:
            message = interfaces.new(
                SCALAR,
                header=interfaces.header(frame.stamp_ns, "body"),
                value=result.angle,
                std=result.std,
            )
            self._writer.write(ANGLE_TOPIC, SCALAR, message, frame.stamp_ns)
        wanted = self._folder is not None or self._writer is not None
        if wanted and (frame.index % self.every == 0 or not result.measured):
            self._overlay(frame, result)

    def _overlay(self, frame: Frame, result: FrameAngle) -> None:
        picture = draw_overlay(frame, result, self.settings)
        self.count += 1
        if self._folder is not None:
            save_overlay(self._folder / f"overlay_{frame.index:06d}.png", picture)
        if self._writer is not None:
            message = interfaces.new(
                COMPRESSED,
                header=interfaces.header(frame.stamp_ns, "camera"),
                format="bgr8; jpeg compressed bgr8",
                data=encode_jpeg(picture),
            )
            self._writer.write(OVERLAY_TOPIC, COMPRESSED, message, frame.stamp_ns)
