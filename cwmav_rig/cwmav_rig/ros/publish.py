# SPDX-License-Identifier: Apache-2.0
"""Recorded messages onto the topics of the rig node, whatever type the recording used for a role."""

from __future__ import annotations

import math
from array import array
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from cwmav_msgs.msg import PowerBlock, ScalarStamped, WrenchBlock
from geometry_msgs.msg import TwistWithCovarianceStamped, Vector3, Wrench, WrenchStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Message
from cwmav_common.ros.codecs import float32_array, nanoseconds, time_message
from cwmav_common.ros.qos import STREAM
from cwmav_common.ros.recorder import message_class
from cwmav_rig.airspeed import from_pitot
from cwmav_rig.live import CycleEvent
from cwmav_rig.topic_map import TopicMap

_BLOCK = 100  # samples put together when a recording has one message per sample


class RigPublisher:
    """Publishes force, power, angle, wind and frequency.

    Parameters
    ----------
    node : who publishes
    wrench_rate : messages per second on the view of the force
    tare_seconds : how much of the last force the tare averages
    """

    def __init__(self, node: Node, wrench_rate: float, tare_seconds: float) -> None:
        self.wrench_rate, self.tare_seconds = wrench_rate, tare_seconds
        self.map = TopicMap()
        self.skipped: dict[str, int] = {}
        self.offset: NDArray[np.float64] = np.zeros(6)
        self._recent: deque[tuple[float, NDArray[np.float64]]] = deque()
        self._next_view = -math.inf
        self._force_samples: list[tuple[int, list[float]]] = []
        self._power_samples: list[tuple[int, float, float]] = []
        self._force_sequence = self._power_sequence = 0
        self._last: dict[str, float] = {}
        create = node.create_publisher
        self._wrench = create(WrenchStamped, "~/wrench", STREAM)
        self._wrench_block = create(WrenchBlock, "~/wrench_block", STREAM)
        self._power_block = create(PowerBlock, "~/power_block", STREAM)
        self._angle = create(ScalarStamped, "~/angle_of_attack", STREAM)
        self._wind = create(TwistWithCovarianceStamped, "~/airspeed", STREAM)
        self._frequency = create(ScalarStamped, "~/flapping_frequency", STREAM)

    def use(self, topic_map: TopicMap) -> None:
        """Take the roles of another recording; forget what belonged to the last one."""
        self.map = topic_map
        self._roles = {topic: role for role, topic in topic_map.topics().items()}
        self._unchanged = self._publishers_of_unchanged(topic_map)
        self.restart()

    def restart(self) -> None:
        """Forget half-filled blocks, as after a jump in time."""
        self._force_samples.clear()
        self._power_samples.clear()
        self._recent.clear()
        self._last.clear()
        self._next_view = -math.inf

    def publish(self, message: Message) -> None:
        """Publish one recorded message under its role; others are none of the rig's topics."""
        role = self._roles.get(message.topic)
        if role is None or role not in _PUBLISHED:
            return
        unchanged = self._unchanged.get((role, message.type_name))
        if unchanged is not None:
            unchanged.publish(bytes(message.data))
            return
        handler = _HANDLERS.get((role, message.type_name))
        if handler is None:
            key = f"{role} as {message.type_name}"
            self.skipped[key] = self.skipped.get(key, 0) + 1
            return
        handler(self, deserialize_message(message.data, message_class(message.type_name)), message)

    def _publishers_of_unchanged(self, topic_map: TopicMap) -> dict[tuple[str, str], Publisher]:
        """Tell what goes out byte by byte as it was recorded, because nothing in it has to be changed."""
        found = {("power", "cwmav_msgs/msg/PowerBlock"): self._power_block}
        if topic_map.angle_of_attack.gain == 1.0 and topic_map.angle_of_attack.offset_deg == 0.0:
            found["angle_of_attack", "cwmav_msgs/msg/ScalarStamped"] = self._angle
        if topic_map.wind.gain == 1.0:
            found["wind", "geometry_msgs/msg/TwistWithCovarianceStamped"] = self._wind
        return found

    def publish_cycle(self, event: CycleEvent) -> None:
        """Publish the frequency of one flapping cycle."""
        header = Header(stamp=time_message(event.stamp_ns))
        self._frequency.publish(ScalarStamped(header=header, value=event.frequency, std=math.nan))

    def tare(self) -> str:
        """Take the mean of the last force as zero from now on.

        Raises
        ------
        InputError
            No force came in yet.
        """
        if not self._recent:
            raise InputError("no force has been replayed yet; resume the replay and try again")
        values = np.concatenate([block for _, block in self._recent])
        values = values[np.isfinite(values).all(axis=1)]
        if not len(values):
            raise InputError(f"the last {self.tare_seconds:g} s hold no usable force sample")
        self.offset = values.mean(axis=0)
        force = ", ".join(f"{value:.4f}" for value in self.offset[:3])
        return f"zero is now ({force}) N, the mean of {len(values)} samples"

    # --- force ---------------------------------------------------------------------------------------------

    def _take_wrench_block(self, block: WrenchBlock, _: Message) -> None:
        values = np.frombuffer(block.data, np.float32).reshape(-1, 6)
        self._force(block, values.astype(np.float64) * self.map.force.gain)

    def _take_wrench(self, wrench: WrenchStamped, _: Message) -> None:
        f, t = wrench.wrench.force, wrench.wrench.torque
        self._force_samples.append((nanoseconds(wrench.header.stamp), [f.x, f.y, f.z, t.x, t.y, t.z]))
        if len(self._force_samples) < _BLOCK:
            return
        times, rows = zip(*self._force_samples, strict=True)
        block = WrenchBlock(
            header=Header(stamp=time_message(times[0]), frame_id=wrench.header.frame_id),
            sample_rate_hz=_rate(times),
            sequence=self._force_sequence,
        )
        self._force_sequence += len(rows)
        self._force_samples.clear()
        self._force(block, np.array(rows) * self.map.force.gain)

    def _force(self, block: WrenchBlock, values: NDArray[np.float64]) -> None:
        start = nanoseconds(block.header.stamp) * 1e-9
        self._recent.append((start, values))
        while self._recent and self._recent[0][0] < start - self.tare_seconds:
            self._recent.popleft()
        tared = values - self.offset
        block.data = float32_array(tared)
        self._wrench_block.publish(block)
        self._view(block.header, start, block.sample_rate_hz, tared)

    def _view(self, header: Header, start: float, rate: float, values: NDArray[np.float64]) -> None:
        end = start + len(values) / rate
        if self._next_view < start:
            self._next_view = start
        while self._next_view < end:
            index = min(round((self._next_view - start) * rate), len(values) - 1)
            fx, fy, fz, tx, ty, tz = values[index].tolist()
            stamp = time_message(round((start + index / rate) * 1e9))
            self._wrench.publish(
                WrenchStamped(
                    header=Header(stamp=stamp, frame_id=header.frame_id),
                    wrench=Wrench(force=Vector3(x=fx, y=fy, z=fz), torque=Vector3(x=tx, y=ty, z=tz)),
                )
            )
            self._next_view += 1.0 / self.wrench_rate

    # --- power ---------------------------------------------------------------------------------------------

    def _take_battery(self, state: Any, _: Message) -> None:
        # BatteryState counts a discharge as negative; here current flows into the vehicle.
        self._electrical(nanoseconds(state.header.stamp), state.voltage, -state.current)

    def _take_voltage(self, scalar: ScalarStamped, _: Message) -> None:
        self._last["voltage"] = scalar.value * self.map.voltage.gain

    def _take_current(self, scalar: ScalarStamped, _: Message) -> None:
        if "voltage" in self._last:
            current = scalar.value * self.map.current.gain
            self._electrical(nanoseconds(scalar.header.stamp), self._last["voltage"], current)

    def _electrical(self, stamp: int, voltage: float, current: float) -> None:
        self._power_samples.append((stamp, voltage, current))
        if len(self._power_samples) < _BLOCK:
            return
        times, voltages, currents = zip(*self._power_samples, strict=True)
        self._power_block.publish(
            PowerBlock(
                header=Header(stamp=time_message(times[0])),
                sample_rate_hz=_rate(times),
                sequence=self._power_sequence,
                voltage=array("f", voltages),
                current=array("f", currents),
            )
        )
        self._power_sequence += len(times)
        self._power_samples.clear()

    # --- angle and wind ------------------------------------------------------------------------------------

    def _take_angle(self, scalar: ScalarStamped, _: Message) -> None:
        self._angle_value(scalar.header, scalar.value, scalar.std)

    def _take_float(self, value: Any, message: Message) -> None:
        self._angle_value(Header(stamp=time_message(message.log_time_ns)), value.data, math.nan)

    def _take_quaternion(self, rotation: Any, _: Message) -> None:
        q = rotation.quaternion
        sine = 2.0 * (q.w * q.y - q.z * q.x)
        # REP 103: y points left, so a positive rotation about it puts the nose down.
        self._angle_value(rotation.header, -math.asin(max(-1.0, min(1.0, sine))), math.nan)

    def _angle_value(self, header: Header, value: float, std: float) -> None:
        role = self.map.angle_of_attack
        true = value * role.gain + math.radians(role.offset_deg)
        self._angle.publish(ScalarStamped(header=header, value=true, std=abs(role.gain) * std))

    def _take_twist_covariance(self, twist: TwistWithCovarianceStamped, _: Message) -> None:
        twist.twist.twist.linear.x *= self.map.wind.gain
        self._wind.publish(twist)

    def _take_twist(self, twist: Any, _: Message) -> None:
        self._wind_value(twist.header, twist.twist.linear.x * self.map.wind.gain)

    def _take_temperature(self, temperature: Any, _: Message) -> None:
        self._last["temperature"] = temperature.temperature

    def _take_pressure(self, pressure: Any, _: Message) -> None:
        if "temperature" in self._last:
            speed = from_pitot(
                np.array(pressure.fluid_pressure), self._last["temperature"], self.map.wind.ambient_pressure
            )
            self._wind_value(pressure.header, float(speed))

    def _wind_value(self, header: Header, speed: float) -> None:
        message = TwistWithCovarianceStamped(header=header)
        message.twist.twist.linear.x = speed
        self._wind.publish(message)


def _rate(times: tuple[int, ...]) -> float:
    """Mean rate of the samples of a block [Hz]."""
    span = (times[-1] - times[0]) * 1e-9
    return (len(times) - 1) / span if span > 0 else math.nan


_HANDLERS: dict[tuple[str, str], Callable[[RigPublisher, Any, Message], None]] = {
    ("force", "cwmav_msgs/msg/WrenchBlock"): RigPublisher._take_wrench_block,
    ("force", "geometry_msgs/msg/WrenchStamped"): RigPublisher._take_wrench,
    ("power", "sensor_msgs/msg/BatteryState"): RigPublisher._take_battery,
    ("voltage", "cwmav_msgs/msg/ScalarStamped"): RigPublisher._take_voltage,
    ("current", "cwmav_msgs/msg/ScalarStamped"): RigPublisher._take_current,
    ("angle_of_attack", "cwmav_msgs/msg/ScalarStamped"): RigPublisher._take_angle,
    ("angle_of_attack", "std_msgs/msg/Float64"): RigPublisher._take_float,
    ("angle_of_attack", "geometry_msgs/msg/QuaternionStamped"): RigPublisher._take_quaternion,
    ("wind", "geometry_msgs/msg/TwistWithCovarianceStamped"): RigPublisher._take_twist_covariance,
    ("wind", "geometry_msgs/msg/TwistStamped"): RigPublisher._take_twist,
    ("wind", "sensor_msgs/msg/FluidPressure"): RigPublisher._take_pressure,
    ("temperature", "sensor_msgs/msg/Temperature"): RigPublisher._take_temperature,
}
_PUBLISHED = {"force", "power", "voltage", "current", "angle_of_attack", "wind", "temperature"}
