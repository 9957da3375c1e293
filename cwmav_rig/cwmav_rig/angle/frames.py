# SPDX-License-Identifier: Apache-2.0
"""Camera frames out of ``Image`` and ``CompressedImage`` messages, as grey pictures with a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Recording
from cwmav_rig.angle.camera_model import CalibratedCamera, from_camera_info

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
IMAGE_TYPES = (IMAGE, COMPRESSED)

# encoding: (channels, bytes per channel, OpenCV conversion to grey or None)
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, None),
    "mono16": (1, 2, None),
    "8UC1": (1, 1, None),
    "16UC1": (1, 2, None),
    "8UC3": (3, 1, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, 1, cv2.COLOR_RGB2GRAY),
    "bgr8": (3, 1, cv2.COLOR_BGR2GRAY),
    "rgba8": (4, 1, cv2.COLOR_RGBA2GRAY),
    "bgra8": (4, 1, cv2.COLOR_BGRA2GRAY),
    "rgb16": (3, 2, cv2.COLOR_RGB2GRAY),
    "bgr16": (3, 2, cv2.COLOR_BGR2GRAY),
    "bayer_rggb8": (1, 1, cv2.COLOR_BayerRGGB2GRAY),
    "bayer_bggr8": (1, 1, cv2.COLOR_BayerBGGR2GRAY),
    "bayer_gbrg8": (1, 1, cv2.COLOR_BayerGBRG2GRAY),
    "bayer_grbg8": (1, 1, cv2.COLOR_BayerGRBG2GRAY),
}

Grey = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Frame:
    """One picture.

    Attributes
    ----------
    index
        Place in the stream, from 0.
    stamp_ns
        Time of acquisition [ns]; the log time where the camera gave none.
    picture
        (rows, columns) grey levels; None when it cannot be read, and `problem` says why.
    number
        The camera's own frame counter, None where it is not recorded.
    name
        How messages call the frame.
    """

    index: int
    stamp_ns: int
    picture: Grey | None
    number: int | None = None
    name: str = ""
    problem: str = ""


def decode_image(message: Any, source: str) -> Grey:
    """Turn a ``sensor_msgs/Image`` into grey levels.

    Raises
    ------
    InputError
        Unknown encoding, or the data does not fit width, height and step.
    """
    if message.encoding not in _ENCODINGS:
        raise InputError(f"{source}: encoding {message.encoding!r}; allowed: {', '.join(_ENCODINGS)}")
    channels, size, conversion = _ENCODINGS[message.encoding]
    rows, columns, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    used = columns * channels * size
    if rows < 1 or columns < 1 or step < used or data.size < rows * step:
        raise InputError(
            f"{source}: {data.size} bytes with step {step} do not hold {columns} x {rows} pixels "
            f"of {message.encoding}"
        )
    lines = data[: rows * step].reshape(rows, step)[:, :used]
    levels: Grey = np.ascontiguousarray(lines)
    if size == 2:
        order = ">" if message.is_bigendian else "<"
        levels = levels.view(f"{order}u2").astype(np.uint16, copy=False)
    if channels > 1:
        levels = levels.reshape(rows, columns, channels)
    return levels if conversion is None else _grey(cv2.cvtColor(levels, conversion))


def decode_compressed(message: Any, source: str) -> Grey:
    """Turn a ``sensor_msgs/CompressedImage`` (JPEG, PNG) into grey levels.

    Raises
    ------
    InputError
        The bytes are no such picture.
    """
    if "compressedDepth" in message.format:
        raise InputError(f"{source}: format {message.format!r} is a depth image; allowed: jpeg, png")
    return decode_bytes(np.asarray(message.data, dtype=np.uint8), source)


def decode_bytes(data: NDArray[np.uint8], source: str) -> Grey:
    """Turn the bytes of a picture file into grey levels, 8 or 16 bit."""
    picture = None
    if data.size:
        try:
            picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
        except cv2.error as error:
            raise InputError(f"{source}: cannot be decoded ({str(error).splitlines()[-1].strip()})") from None
    if picture is None:
        raise InputError(f"{source}: {data.size} bytes are no readable picture")
    return _grey(picture)


def _grey(picture: Any) -> Grey:
    if picture.dtype not in (np.uint8, np.uint16):
        raise InputError(f"grey levels are {picture.dtype}; allowed: uint8, uint16")
    grey: Grey = picture
    return grey


def bag_frames(recording: Recording, topic: str, info_topic: str | None = None) -> Iterator[Frame]:
    """Read the frames of one topic in order of log time; unreadable ones say so and are passed on.

    Parameters
    ----------
    info_topic
        CameraInfo topic that is watched on the way.

    Raises
    ------
    InputError
        The recording has no such topic, it holds no pictures, or the calibration changes on the way.
    """
    type_name = _image_topic(recording, topic)
    return _bag_frames(recording, topic, type_name, info_topic)


def _bag_frames(recording: Recording, topic: str, type_name: str, info_topic: str | None) -> Iterator[Frame]:
    index = 0
    first: tuple[Any, ...] | None = None
    for message in recording.messages({topic, info_topic or topic}):
        if message.topic == topic:
            name = f"{recording.path}: {topic} frame {index}"
            yield frame_of(message.data, type_name, message.log_time_ns, index, name)
            index += 1
            continue
        signature = calibration_signature(interfaces.deserialise(message.data, CAMERA_INFO))
        first = first or signature
        if signature != first:
            raise InputError(f"{recording.path}: the calibration on {info_topic} changes at frame {index}")


def calibration_signature(info: Any) -> tuple[Any, ...]:
    """Give everything in a CameraInfo that matters, to recognise a change."""
    roi = info.roi
    return (
        info.width, info.height, info.distortion_model, *info.k, *info.d, *info.r,
        info.binning_x, info.binning_y, roi.x_offset, roi.y_offset, roi.width, roi.height,
    )  # fmt: skip


def frame_of(data: bytes, type_name: str, log_time_ns: int, index: int, name: str) -> Frame:
    """Decode one CDR message of an image type."""
    try:
        message = interfaces.deserialise(data, type_name)
    except InputError as error:
        return Frame(index, log_time_ns, None, None, name, str(error))
    stamp = message.header.stamp
    stamp_ns = int(stamp.sec) * interfaces.NANOSECONDS + int(stamp.nanosec) or log_time_ns
    decode = decode_image if type_name == IMAGE else decode_compressed
    try:
        return Frame(index, stamp_ns, decode(message, name), None, name)
    except InputError as error:
        return Frame(index, stamp_ns, None, None, name, str(error))


def image_topics(recording: Recording) -> list[str]:
    """Name the topics that hold pictures."""
    return [topic.name for topic in recording.topics.values() if topic.type_name in IMAGE_TYPES]


def _image_topic(recording: Recording, topic: str) -> str:
    topics = recording.topics
    if topic not in topics:
        raise InputError(
            f"{recording.path}: no topic {topic}; "
            f"image topics: {', '.join(image_topics(recording)) or 'none'}"
        )
    if topics[topic].type_name not in IMAGE_TYPES:
        raise InputError(
            f"{recording.path}: topic {topic} is {topics[topic].type_name}; allowed: {', '.join(IMAGE_TYPES)}"
        )
    return topics[topic].type_name


def bag_camera(recording: Recording, topic: str) -> CalibratedCamera | None:
    """Read the first CameraInfo of `topic`; None when it says that the camera is not calibrated.

    Raises
    ------
    InputError
        There is no such topic or no message on it.
    """
    known = recording.topics
    if topic not in known or known[topic].type_name != CAMERA_INFO:
        raise InputError(f"{recording.path}: {topic} is no topic of {CAMERA_INFO}")
    for message in recording.messages([topic]):
        info = interfaces.deserialise(message.data, CAMERA_INFO)
        return from_camera_info(info, f"{recording.path}: {topic}")
    raise InputError(f"{recording.path}: no message on {topic}")
