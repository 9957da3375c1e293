# SPDX-License-Identifier: Apache-2.0
"""Writes what is published into an MCAP file: raw bytes from the wire, nothing decoded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from cwmav_common.interfaces import known
from cwmav_common.mcap_writer import BagWriter

_LOOK_AROUND = 1.0  # s between looks for new topics
_DEPTH = 1000


class Recorder:
    """Records the topics that `wanted` accepts, also those that appear later.

    Every subscription asks for what the topic's publishers offer: reliable and latched where all of them are.

    Parameters
    ----------
    node : who subscribes
    path : MCAP file to write
    wanted : takes a topic name
    metadata : facts about the recording, kept in the file
    """

    def __init__(
        self,
        node: Node,
        path: Path,
        wanted: Callable[[str], bool],
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self._node, self._wanted = node, wanted
        self._writer = BagWriter(path)
        if metadata:
            self._writer.add_metadata("cwmav", metadata)
        self._subscriptions: dict[str, Subscription] = {}
        self.messages = 0
        self.unknown: set[str] = set()
        self._timer = node.create_timer(
            _LOOK_AROUND, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.look()

    def look(self) -> None:
        """Subscribe to wanted topics that are new."""
        for topic, types in self._node.get_topic_names_and_types():
            if topic in self._subscriptions or not self._wanted(topic):
                continue
            publishers = self._node.get_publishers_info_by_topic(topic)
            if len(types) != 1 or not publishers:
                continue
            if not known(types[0]):
                self.unknown.add(f"{topic} ({types[0]})")
                continue
            self._subscribe(topic, types[0], [info.qos_profile for info in publishers])

    def close(self) -> None:
        """Finish the file."""
        self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
        self._writer.close()

    def _subscribe(self, topic: str, type_name: str, offered: Sequence[QoSProfile]) -> None:
        reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offered)
        latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
        qos = QoSProfile(
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        self._writer.add_topic(topic, type_name, latched=latched)
        self._subscriptions[topic] = self._node.create_subscription(
            message_class(type_name), topic, partial(self._write, topic, type_name), qos, raw=True
        )

    def _write(self, topic: str, type_name: str, data: bytes) -> None:
        self._writer.write_raw(topic, type_name, data, self._node.get_clock().now().nanoseconds)
        self.messages += 1


def message_class(type_name: str) -> Any:
    """Import the class of a message type ``package/msg/Name``."""
    package, _, name = type_name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), name)
