# SPDX-License-Identifier: Apache-2.0
"""Calls into the executor's thread, from any other thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rclpy.node import Node


class CallQueue:
    """Runs functions in the thread that spins the node, in the order they were posted.

    Nodes are not made for several threads. Results of workers therefore enter the node here, woken by a guard
    condition: no polling.
    """

    def __init__(self, node: Node) -> None:
        self._calls: deque[Callable[[], None]] = deque()
        self._guard = node.create_guard_condition(self._run)
        self._open = True

    def post(self, call: Callable[[], None]) -> None:
        """Have `call` run soon; dropped when the node is closed."""
        if self._open:
            self._calls.append(call)
            self._guard.trigger()

    def close(self) -> None:
        """Drop what has not run."""
        self._open = False
        self._calls.clear()

    def _run(self) -> None:
        for _ in range(len(self._calls)):
            self._calls.popleft()()
