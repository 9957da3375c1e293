# SPDX-License-Identifier: Apache-2.0
"""Cameras: pictures that appear in a folder, or a video stream."""

from __future__ import annotations

import re
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from cwmav_common.errors import InputError
from cwmav_rig.angle.folder import SUFFIXES
from cwmav_rig.angle.frames import decode_bytes
from cwmav_rig.instruments.messages import compressed_image, grey_image
from cwmav_rig.instruments.protocol import Identity, InstrumentError, Reading
from cwmav_rig.instruments.settings import CameraSettings

WAIT = 0.05  # s
KEPT = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}  # files that go into the recording as they are
_NUMBER = re.compile(r"(\d+)$")


class FolderCamera:
    """Pictures of a folder, in the order of their names, as they appear.

    A picture counts as complete once its size did not change between two looks. What lies in the folder at
    the start is left alone.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self.name, self.stall, self.rate = "camera", settings.stall, settings.rate
        self._folder = Path(settings.folder)
        self._seen: set[str] = set()
        self._sizes: dict[str, int] = {}
        self._last: int | None = None
        self._damaged = 0
        self._zero: tuple[int, int] | None = None  # number and time [ns] of the first picture

    def open(self) -> Identity:
        """See that the folder is there."""
        if not self._folder.is_dir():
            raise InstrumentError(f"camera: {self._folder} is no folder")
        return Identity(
            f"pictures in {self._folder}", {"folder": str(self._folder), "rate_hz": str(self.rate)}
        )

    def start(self) -> None:
        """Watch for what appears from now on."""
        self._seen = {path.name for path in self._folder.iterdir()}
        self._sizes, self._last, self._zero, self._damaged = {}, None, None, 0

    def read(self) -> list[Reading]:
        """Give the pictures that are complete since the last look."""
        time.sleep(WAIT)
        if not self._folder.is_dir():
            raise InstrumentError(f"camera: {self._folder} is gone")
        found = []
        for path in sorted(self._folder.iterdir(), key=lambda path: (_number(path.name) or 0, path.name)):
            if path.name in self._seen or path.suffix.lower() not in SUFFIXES:
                continue
            size = path.stat().st_size
            if not size or self._sizes.get(path.name) != size:
                self._sizes[path.name] = size
                continue
            self._seen.add(path.name)
            self._sizes.pop(path.name)
            reading = self._picture(path)
            if reading is not None:
                found.append(reading)
        return found

    def _picture(self, path: Path) -> Reading | None:
        number, written = _number(path.name), path.stat().st_mtime_ns
        lost, self._damaged = self._damaged, 0
        if number is not None and self._last is not None:
            lost += max(0, number - self._last - 1)
        stamp = written
        if number is not None:
            self._last = number
            if self.rate > 0.0:
                self._zero = self._zero or (number, written)
                stamp = self._zero[1] + round((number - self._zero[0]) / self.rate * 1e9)
        content = path.read_bytes()
        kind = KEPT.get(path.suffix.lower())
        if kind is not None:
            return compressed_image(stamp, kind, content, lost)
        try:
            return grey_image(stamp, decode_bytes(np.frombuffer(content, np.uint8), str(path)), lost)
        except InputError:
            self._damaged = lost + 1  # told with the next picture
            return None

    def stop(self) -> None:
        """Look no more; the folder goes on filling."""

    def close(self) -> None:
        """Nothing is held."""


class StreamCamera:
    """Frames of a camera or a network stream, by OpenCV, in grey."""

    def __init__(self, settings: CameraSettings) -> None:
        self.name, self.stall, self.rate = "camera", settings.stall, settings.rate
        self._source: int | str = int(settings.stream) if settings.stream.isdigit() else settings.stream
        self._capture: Any = None
        self._lock = threading.Lock()

    def open(self) -> Identity:
        """Open the stream and take one frame."""
        import cv2

        self._capture = cv2.VideoCapture(self._source)
        grabbed = self._capture.isOpened() and self._capture.grab()
        if not grabbed:
            self.close()
            raise InstrumentError(f"camera: stream {self._source} gives no frames")
        width, height = (
            int(self._capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        self.rate = self.rate or float(self._capture.get(cv2.CAP_PROP_FPS) or 0.0)
        return Identity(f"stream {self._source}", {"width": str(width), "height": str(height)})

    def start(self) -> None:
        """Do nothing: the stream runs from the opening on."""

    def read(self) -> list[Reading]:
        """Wait for the next frame."""
        import cv2

        with self._lock:
            if self._capture is None:
                return []
            good, picture = self._capture.read()
        if not good:
            raise InstrumentError(f"camera: stream {self._source} ended")
        stamp = time.time_ns()
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        return [grey_image(stamp, grey)]

    def stop(self) -> None:
        """Read no more; the stream runs on."""

    def close(self) -> None:
        """Let the camera go."""
        with self._lock:
            if self._capture is not None:
                self._capture.release()
                self._capture = None


def _number(name: str) -> int | None:
    match = _NUMBER.search(Path(name).stem)
    return int(match.group(1)) if match else None
