# SPDX-License-Identifier: Apache-2.0
"""Readings of instruments as messages, on the topics that a recording of the rig uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_common import interfaces
from cwmav_rig.instruments.protocol import Reading

Array = NDArray[np.float64]

FORCE, POWER, WIND = "/rig/wrench_block", "/rig/power_block", "/rig/airspeed"
IMAGE, COMPRESSED, CAMERA_INFO = "/camera/image_raw", "/camera/image_raw/compressed", "/camera/camera_info"
WRENCH_BLOCK, POWER_BLOCK = "cwmav_msgs/msg/WrenchBlock", "cwmav_msgs/msg/PowerBlock"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
IMAGE_TYPE, COMPRESSED_TYPE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def wrench_block(
    stamp_ns: int, rate: float, sequence: int, data: Array, *, lost: int = 0, overload: int = 0
) -> Reading:
    """Force and moment (n, 6) [N, N m] at `rate` [Hz]; `sequence` numbers the first sample."""
    message = interfaces.new(
        WRENCH_BLOCK,
        header=interfaces.header(stamp_ns, "sensor"),
        sample_rate_hz=rate,
        sequence=sequence,
        lost=lost,
        overload=overload,
        data=np.asarray(data, np.float32).ravel(),
    )
    return Reading(FORCE, WRENCH_BLOCK, message, len(data), lost)


def power_block(
    stamp_ns: int, rate: float, sequence: int, voltage: Array, current: Array, *, lost: int = 0
) -> Reading:
    """Voltage (n,) [V] and current (n,) [A] at `rate` [Hz]."""
    message = interfaces.new(
        POWER_BLOCK,
        header=interfaces.header(stamp_ns, "scope"),
        sample_rate_hz=rate,
        sequence=sequence,
        lost=lost,
        voltage=np.asarray(voltage, np.float32),
        current=np.asarray(current, np.float32),
    )
    return Reading(POWER, POWER_BLOCK, message, len(voltage), lost)


def airspeed(stamp_ns: int, speed: float, std: float) -> Reading:
    """Airspeed [m/s] with its standard uncertainty."""
    message = interfaces.new(TWIST, header=interfaces.header(stamp_ns, "tunnel"))
    message.twist.twist.linear.x = speed
    message.twist.covariance[0] = std**2
    return Reading(WIND, TWIST, message)


def grey_image(stamp_ns: int, picture: NDArray, lost: int = 0) -> Reading:
    """Grey picture (rows, columns) of 8 or 16 bits."""
    rows, columns = picture.shape
    deep = picture.dtype == np.uint16
    picture = np.ascontiguousarray(picture, "<u2" if deep else np.uint8)
    message = interfaces.new(
        IMAGE_TYPE,
        header=interfaces.header(stamp_ns, "camera"),
        height=rows,
        width=columns,
        encoding="mono16" if deep else "mono8",
        is_bigendian=0,
        step=picture.strides[0],
        data=picture.view(np.uint8).ravel(),
    )
    return Reading(IMAGE, IMAGE_TYPE, message, 1, lost)


def compressed_image(stamp_ns: int, kind: str, content: bytes, lost: int = 0) -> Reading:
    """Picture as its file holds it; `kind` is ``png`` or ``jpeg``."""
    message = interfaces.new(
        COMPRESSED_TYPE,
        header=interfaces.header(stamp_ns, "camera"),
        format=kind,
        data=np.frombuffer(content, np.uint8),
    )
    return Reading(COMPRESSED, COMPRESSED_TYPE, message, 1, lost)
