# SPDX-License-Identifier: Apache-2.0
"""Health of a node on ``/diagnostics``, once a second."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

PERIOD = 1.0  # s
INSTANCE = "instance"
"""Key whose value differs from one start of a node to the next."""

_LEVELS = {
    "ok": DiagnosticStatus.OK,
    "warn": DiagnosticStatus.WARN,
    "error": DiagnosticStatus.ERROR,
    "stale": DiagnosticStatus.STALE,
}


@dataclass(frozen=True)
class Health:
    """State of one part: level ``ok``, ``warn``, ``error`` or ``stale``, a line for a person, and numbers."""

    message: str
    level: str = "ok"
    values: Mapping[str, Any] = field(default_factory=dict)


class Diagnostics:
    """Publishes the health of the parts of a node.

    The period is wall time even where the node lives in simulated time, because a node on a stopped clock is
    alive.
    """

    def __init__(self, node: Node, hardware_id: str) -> None:
        self._node, self._hardware_id = node, hardware_id
        self._parts: dict[str, Callable[[], Health]] = {}
        self.instance = uuid.uuid4().hex
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = node.create_timer(PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def add(self, part: str, health: Callable[[], Health]) -> None:
        """Ask `health` once a second; it must answer at once."""
        self._parts[part] = health

    def remove(self, part: str) -> None:
        """Ask a part no more."""
        self._parts.pop(part, None)

    def publish(self) -> None:
        """Publish now, besides the regular times."""
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.status = [self._status(part, health) for part, health in self._parts.items()]
        self._publisher.publish(array)

    def _status(self, part: str, health: Callable[[], Health]) -> DiagnosticStatus:
        state = health()
        values = {INSTANCE: self.instance, **state.values}
        return DiagnosticStatus(
            level=_LEVELS[state.level],
            name=f"{self._node.get_fully_qualified_name()}: {part}",
            message=state.message,
            hardware_id=self._hardware_id,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
