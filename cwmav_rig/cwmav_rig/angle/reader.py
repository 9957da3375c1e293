# SPDX-License-Identifier: Apache-2.0
"""Camera frames that arrive in batches of messages, recorded or live, turned into the angle of attack."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Batch
from cwmav_rig.angle.camera_model import CalibratedCamera, from_camera_info
from cwmav_rig.angle.frames import CAMERA_INFO, calibration_signature, frame_of
from cwmav_rig.angle.settings import AngleSettings
from cwmav_rig.angle.stream import Collector, as_series
from cwmav_rig.blocks import Series

_PATIENCE = 200  # frames kept until the calibration arrives


class CameraRole(Protocol):
    """The part of the topic map that says how camera frames become angles."""

    @property
    def gain(self) -> float:
        """Factor on angles that were recorded as numbers."""

    @property
    def offset_deg(self) -> float:
        """Offset of angles that were recorded as numbers."""

    @property
    def camera_info(self) -> str:
        """CameraInfo topic, empty when there is none."""

    @property
    def camera(self) -> AngleSettings:
        """Settings of the measurement."""


def role_settings(role: CameraRole, source: str) -> AngleSettings:
    """Give the settings of the measurement that a topic map holds.

    Raises
    ------
    InputError
        The map also has a gain or an offset, which pictures do not need.
    """
    if role.gain != 1.0 or role.offset_deg != 0.0:
        raise InputError(
            f"{source}: angle_of_attack has gain {role.gain:g} and offset_deg {role.offset_deg:g}; "
            "for camera frames use camera.nose, camera.camera_roll_deg and camera.edge_to_axis_deg"
        )
    return role.camera


class PictureReader:
    """Measures frames as they come; the angles so far can be had at any time.

    Parameters
    ----------
    role
        Of the topic map.
    source
        Name of the recording, for messages.
    """

    def __init__(self, role: CameraRole, source: str) -> None:
        self.source = source
        self._info_topic = role.camera_info
        self._collector = Collector(role_settings(role, source))
        self._lens: CalibratedCamera | None = None
        self._signature: tuple[Any, ...] | None = None
        self._waiting: list[tuple[bytes, str, int]] = []
        self._count = 0

    def take(self, batch: Batch) -> None:
        """Measure the frames of a batch; they wait while the calibration is not known yet.

        Raises
        ------
        InputError
            The calibration does not come or does not fit the pictures.
        """
        type_name = batch.topic.type_name
        arrived = [(data, type_name, stamp) for data, stamp in _messages(batch)]
        if self._info_topic and self._signature is None:
            self._waiting.extend(arrived)
            if len(self._waiting) > _PATIENCE:
                self.require_calibration()
            return
        for message in arrived:
            self._measure(*message)

    def take_calibration(self, batch: Batch) -> None:
        """Take the CameraInfo messages of a batch.

        Raises
        ------
        InputError
            The calibration cannot be used, or changes on the way.
        """
        for data, _ in _messages(batch):
            info = interfaces.deserialise(data, CAMERA_INFO)
            signature = calibration_signature(info)
            if self._signature is None:
                self._lens = from_camera_info(info, f"{self.source}: {self._info_topic}")
                self._signature = signature
            elif signature != self._signature:
                raise InputError(
                    f"{self.source}: the calibration on {self._info_topic} changes within the recording"
                )
        waiting, self._waiting = self._waiting, []
        for message in waiting:
            self._measure(*message)

    def require_calibration(self) -> None:
        """Raise InputError when frames still wait for their calibration."""
        if self._waiting:
            raise InputError(
                f"{self.source}: no CameraInfo on {self._info_topic} for {len(self._waiting)} camera frames"
            )

    def series(self, origin_ns: int) -> Series | None:
        """Give the angles measured so far, times [s] from `origin_ns`; None before the first frame."""
        return as_series(self._collector.stream(), origin_ns) if self._count else None

    def _measure(self, data: bytes, type_name: str, log_time_ns: int) -> None:
        name = f"{self.source}: camera frame {self._count}"
        self._collector.take(frame_of(data, type_name, log_time_ns, self._count, name), self._lens)
        self._count += 1


def _messages(batch: Batch) -> Iterator[tuple[bytes, int]]:
    ends = batch.starts + batch.lengths
    times = batch.log_times.tolist()
    for start, end, time in zip(batch.starts.tolist(), ends.tolist(), times, strict=True):
        yield batch.buffer[start:end].tobytes(), time
