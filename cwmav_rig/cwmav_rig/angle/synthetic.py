# SPDX-License-Identifier: Apache-2.0
"""A simulated camera: frames as a high-speed camera gives them, with the truth known, marked synthetic."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from cwmav_common import interfaces
from cwmav_common.errors import InputError, WorkError
from cwmav_common.mcap_writer import BagWriter
from cwmav_common.settings import setting, to_mapping
from cwmav_rig.angle.camera_model import CalibratedCamera
from cwmav_rig.angle.folder import TIMES
from cwmav_rig.angle.frames import CAMERA_INFO, COMPRESSED, IMAGE, Frame
from cwmav_rig.angle.synthetic_scene import Optics, Pose, Renderer, Scene, camera_of

Array = NDArray[np.float64]

IMAGE_TOPIC = "/camera/image_raw"
INFO_TOPIC = "/camera/camera_info"
CAMERA_FILE = "camera_info.yaml"
TRUTH_FILE = "truth.csv"


@dataclass(frozen=True)
class SyntheticCamera:
    """A camera that looks at a flapping vehicle; the same seed gives the same pictures.

    The angle of attack is its mean, a Gaussian wandering with a memory of `wander_time` and a rocking at the
    flapping frequency; the paper's 0.46 deg is 0.35 deg of the one and 0.43 deg amplitude of the other.
    """

    frames: int = setting(200, "frames taken, dropped ones included", ge=1)
    rate: float = setting(1000.0, "frames per second", unit="Hz", gt=0)
    seed: int = setting(0, "seed of everything random", ge=0)
    angle_of_attack_deg: float = setting(15.0, "mean angle of attack", unit="deg", gt=-90, lt=90)
    wander_deg: float = setting(0.35, "standard deviation of the slow wandering", unit="deg", ge=0)
    wander_time: float = setting(0.05, "memory of the wandering", unit="s", gt=0)
    rocking_deg: float = setting(0.43, "amplitude of the rocking at the flapping frequency", unit="deg", ge=0)
    flapping_frequency: float = setting(12.0, "wing beats per second", unit="Hz", gt=0)
    heave_px: float = setting(
        3.0, "amplitude of the up and down of the body at that frequency", unit="px", ge=0
    )
    exposure: float = setting(0.0003, "exposure time", unit="s", ge=0)
    dropped: float = setting(0.0, "probability that a frame is lost", ge=0, lt=1)
    repeated: float = setting(0.0, "probability that a frame is sent twice", ge=0, lt=1)
    stamp_jitter: float = setting(2e-5, "standard deviation of the stamps", unit="s", ge=0)
    start_ns: int = setting(1_700_000_000_000_000_000, "stamp of the first frame", unit="ns", ge=0)
    scene: Scene = field(default_factory=Scene)
    optics: Optics = field(default_factory=Optics)

    @property
    def camera(self) -> CalibratedCamera | None:
        """Calibration of the lens."""
        return camera_of(self.scene, self.optics)

    def take(self) -> Iterator[tuple[Frame, float]]:
        """Give each frame with the true angle of attack [rad] in the middle of its exposure."""
        draws = np.random.default_rng([self.seed, 0])
        angle, rate, heave, speed, stroke = self._motion(draws)
        jitter = draws.standard_normal(self.frames) * self.stamp_jitter
        lost = draws.random(self.frames) < self.dropped
        twice = draws.random(self.frames) < self.repeated
        renderer = Renderer(self.scene, self.optics)
        index = 0
        for k in range(self.frames):
            if lost[k]:
                continue
            pose = Pose(
                angle=float(angle[k]),
                y=float(heave[k]),
                sweep=float(rate[k] * self.exposure),
                drift=(0.0, float(speed[k] * self.exposure)),
                stroke=float(stroke[k]),
            )
            # Noise of a frame depends on its number only, so that lost frames leave the others as they are.
            picture = renderer.draw(pose, np.random.default_rng([self.seed, 1, k]))
            stamp = self.start_ns + round((k / self.rate + jitter[k]) * 1e9)
            for copy in range(2 if twice[k] else 1):
                shifted = stamp + round(copy * 0.3e9 / self.rate)
                yield Frame(index, shifted, picture, k, f"synthetic frame {k}"), pose.angle
                index += 1

    def _motion(self, rng: np.random.Generator) -> tuple[Array, Array, Array, Array, Array]:
        """Angle [rad], its rate [rad/s], heave [px], its rate [px/s], stroke (-1 to 1), (n,) each."""
        time = np.arange(self.frames) / self.rate
        memory = np.exp(-1.0 / (self.rate * self.wander_time))
        kicks = rng.standard_normal(self.frames)
        wander = np.empty(self.frames)
        wander[0] = kicks[0]
        for k in range(1, self.frames):
            wander[k] = memory * wander[k - 1] + np.sqrt(1 - memory**2) * kicks[k]
        turn = 2 * np.pi * self.flapping_frequency
        phase = turn * time + rng.uniform(0, 2 * np.pi)
        rocking = np.deg2rad(self.rocking_deg)
        angle = np.deg2rad(self.angle_of_attack_deg + self.wander_deg * wander) + rocking * np.sin(phase)
        heave = self.heave_px * np.cos(phase)
        return (
            angle,
            rocking * turn * np.cos(phase),
            heave,
            -self.heave_px * turn * np.sin(phase),
            np.cos(phase),
        )


def write_bag(
    device: SyntheticCamera,
    path: str | Path,
    encoding: str = "mono8",
    on_frame: Callable[[float], None] | None = None,
) -> Array:
    """Record the simulated camera to MCAP and give the true angles, (n,) [rad].

    Parameters
    ----------
    encoding
        ``mono8``, ``rgb8`` or ``bgr8`` for ``Image``; ``png`` or ``jpeg`` for ``CompressedImage``.

    Raises
    ------
    InputError
        Another encoding.
    """
    truth: list[float] = []
    stamps: list[int] = []
    camera = device.camera
    with BagWriter(path) as writer:
        for frame, angle in device.take():
            if camera is not None:
                info = _camera_info(camera, frame.stamp_ns)
                writer.write(INFO_TOPIC, CAMERA_INFO, info, frame.stamp_ns)
            type_name, message, suffix = _message(frame, encoding)
            writer.write(IMAGE_TOPIC + suffix, type_name, message, frame.stamp_ns)
            truth.append(angle)
            stamps.append(frame.stamp_ns)
            if on_frame is not None:
                on_frame(1)
        settings = json.dumps(to_mapping(device), sort_keys=True)
        values = {"synthetic": "true", "settings": settings, "angle_of_attack_rad": json.dumps(truth)}
        writer.add_metadata("cwmav_camera", {**values, "stamps_ns": json.dumps(stamps)})
    return np.array(truth)


def write_folder(
    device: SyntheticCamera, folder: str | Path, on_frame: Callable[[float], None] | None = None
) -> Array:
    """Write PNG pictures, their times, the calibration and the truth; give the true angles, (n,) [rad].

    Raises
    ------
    InputError
        The folder exists and is not empty.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty")
    rows: list[tuple[str, int, float]] = []
    for frame, angle in device.take():
        name = f"frame_{frame.index:06d}.png"
        if frame.picture is None or not cv2.imwrite(str(folder / name), frame.picture):
            raise WorkError(f"{folder / name}: cannot be written")
        rows.append((name, frame.stamp_ns, angle))
        if on_frame is not None:
            on_frame(1)
    _write_rows(folder / TIMES, ("file", "stamp_ns"), [row[:2] for row in rows])
    truth = [(name, f"{angle:.12f}", "synthetic") for name, _, angle in rows]
    _write_rows(folder / TRUTH_FILE, ("file", "angle_of_attack_rad", "origin"), truth)
    if device.camera is not None:
        text = yaml.safe_dump(_calibration_file(device.camera), sort_keys=False)
        (folder / CAMERA_FILE).write_text(text, encoding="utf-8")
    return np.array([angle for _, _, angle in rows])


def _write_rows(path: Path, header: tuple[str, ...], rows: list[Any]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(header)
        table.writerows(rows)


def _message(frame: Frame, encoding: str) -> tuple[str, Any, str]:
    picture = frame.picture
    if picture is None:
        raise WorkError(f"{frame.name}: no picture")
    header = interfaces.header(frame.stamp_ns, "camera")
    if encoding in ("png", "jpeg"):
        done, data = cv2.imencode(".png" if encoding == "png" else ".jpg", picture)
        if not done:
            raise WorkError(f"{frame.name}: cannot be encoded as {encoding}")
        values = {"header": header, "format": f"mono8; {encoding} compressed", "data": data.ravel()}
        return COMPRESSED, interfaces.new(COMPRESSED, **values), "/compressed"
    if encoding not in ("mono8", "rgb8", "bgr8"):
        raise InputError(f"encoding {encoding!r}; allowed: mono8, rgb8, bgr8, png, jpeg")
    levels = picture if encoding == "mono8" else np.repeat(picture[:, :, None], 3, axis=2)
    rows, columns = picture.shape
    values = {
        "header": header,
        "height": rows,
        "width": columns,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": levels.nbytes // rows,
        "data": levels.ravel(),
    }
    return IMAGE, interfaces.new(IMAGE, **values), ""


def _camera_info(camera: CalibratedCamera, stamp_ns: int) -> Any:
    projection = np.hstack([camera.matrix, np.zeros((3, 1))])
    return interfaces.new(
        CAMERA_INFO,
        header=interfaces.header(stamp_ns, "camera"),
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        d=camera.distortion[:5],
        k=camera.matrix.ravel(),
        r=camera.rotation.ravel(),
        p=projection.ravel(),
    )


def _calibration_file(camera: CalibratedCamera) -> dict[str, Any]:
    def block(rows: int, columns: int, values: Array) -> dict[str, Any]:
        return {"rows": rows, "cols": columns, "data": values.ravel().tolist()}

    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": "synthetic",
        "camera_matrix": block(3, 3, camera.matrix),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": block(1, 5, camera.distortion[:5]),
        "rectification_matrix": block(3, 3, camera.rotation),
        "projection_matrix": block(3, 4, np.hstack([camera.matrix, np.zeros((3, 1))])),
    }
