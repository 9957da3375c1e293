# SPDX-License-Identifier: Apache-2.0
"""Core values to messages and back; arrays go through ``array.array``, which rclpy copies as one block."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from cwmav_msgs.msg import ControlPoint
from geometry_msgs.msg import Point
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

_NANOSECONDS = 1_000_000_000


def time_message(nanoseconds: int) -> Time:
    """Make a stamp from a time in nanoseconds."""
    sec, nanosec = divmod(int(nanoseconds), _NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def nanoseconds(stamp: Time) -> int:
    """Give the time of a stamp in nanoseconds."""
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def control_point(point: ArrayLike) -> ControlPoint:
    """Make a control point from (F [Hz], AoA [rad], U [m/s])."""
    frequency, angle, velocity = (float(value) for value in np.asarray(point))
    return ControlPoint(flapping_frequency=frequency, angle_of_attack=angle, forward_velocity=velocity)


def point_array(message: ControlPoint) -> NDArray[np.float64]:
    """Give (F [Hz], AoA [rad], U [m/s]) of a control point."""
    return np.array([message.flapping_frequency, message.angle_of_attack, message.forward_velocity])


def float32_array(values: ArrayLike) -> array[float]:
    """Give the row-major values as a float32 array of a message field."""
    return array("f", np.ascontiguousarray(values, dtype=np.float32).tobytes())


def point_cloud(header: Header, positions: ArrayLike, fields: Mapping[str, ArrayLike]) -> PointCloud2:
    """Make a cloud of `positions` (n, 3) [m] with further float32 `fields` (n,)."""
    columns = [
        np.asarray(positions, dtype=np.float32),
        *(np.asarray(f, np.float32)[:, None] for f in fields.values()),
    ]
    table = np.ascontiguousarray(np.hstack(columns))
    names = ("x", "y", "z", *fields)
    width = len(names) * 4
    return PointCloud2(
        header=header,
        height=1,
        width=len(table),
        fields=[
            PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
            for index, name in enumerate(names)
        ],
        is_bigendian=False,
        point_step=width,
        row_step=width * len(table),
        data=array("B", table.tobytes()),
        is_dense=bool(np.isfinite(table).all()),
    )


def triangle_marker(
    header: Header,
    name: str,
    positions: NDArray[Any],
    triangles: NDArray[Any],
    rgba: tuple[float, float, float, float],
) -> Marker:
    """Make a surface of `triangles` (m, 3) over `positions` (n, 3) [m]."""
    corners = np.asarray(positions, dtype=float)[np.asarray(triangles).reshape(-1)]
    marker = Marker(header=header, ns=name, id=0, type=Marker.TRIANGLE_LIST, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    red, green, blue, alpha = rgba
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners.tolist()]
    return marker
