# SPDX-License-Identifier: Apache-2.0
"""One private corner of ROS per test: own context, domain and namespace, a spinning thread, deadlines."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

DEADLINE = 60.0  # s; long, because the machine may be busy; reached only when something is wrong
# Below 101, where the ports of a domain cannot meet those the system hands out.
DOMAIN = 1 + os.getpid() % 100
_numbers = itertools.count(1)
N = TypeVar("N", bound=Node)


class Ros:
    """Nodes of one test and the means to talk to them."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.namespace = f"/test_{os.getpid()}_{next(_numbers)}"
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []
        self.tester = self.add(rclpy.create_node("tester", context=self.context, namespace=self.namespace))
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def add(self, node: N) -> N:
        """Spin a node until the end of the test."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def make(self, cls: Callable[..., N], *arguments: Any, **parameters: Any) -> N:
        """Make a node of the suite in this corner; keywords are its ROS parameters."""
        overrides = [Parameter(key, value=value) for key, value in parameters.items()]
        node = cls(*arguments, context=self.context, namespace=self.namespace, parameter_overrides=overrides)
        return self.add(node)

    def name(self, name: str) -> str:
        """Put a name like ``sim/evaluate_lift`` into the namespace."""
        return f"{self.namespace}/{name}"

    def remove(self, node: Node) -> None:
        """Close and destroy a node now."""
        self.nodes.remove(node)
        self._close(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def call(self, service_type: Any, name: str, deadline: float = DEADLINE, **fields: Any) -> Any:
        """Call a service and give its response."""
        return self.call_later(service_type, name, **fields)(deadline)

    def call_later(self, service_type: Any, name: str, **fields: Any) -> Callable[..., Any]:
        """Call a service; the function given back waits for the response."""
        client = self.tester.create_client(service_type, self.name(name))
        wait_for(client.service_is_ready, f"service {name}")
        future = client.call_async(service_type.Request(**fields))

        def response(deadline: float = DEADLINE) -> Any:
            wait_for(future.done, f"response of {name}", deadline)
            self.tester.destroy_client(client)
            return future.result()

        return response

    def collect(self, message_type: Any, name: str, qos: Any = 1000) -> list[Any]:
        """Subscribe; the list grows with every message."""
        messages: list[Any] = []
        topic = name if name.startswith("/") else self.name(name)
        self.tester.create_subscription(message_type, topic, messages.append, qos)
        return messages

    def goal(self, action_type: Any, name: str, **fields: Any) -> Goal:
        """Send a goal and wait for its acceptance."""
        return Goal(self, action_type, self.name(name), fields)

    def close(self) -> None:
        """Close everything, in the order that leaves no thread behind."""
        for node in self.nodes:
            self._close(node)
        self.executor.shutdown(timeout_sec=5.0)
        self.thread.join(timeout=10.0)
        for node in self.nodes:
            node.destroy_node()
        self.context.try_shutdown()
        assert not self.thread.is_alive()

    @staticmethod
    def _close(node: Node) -> None:
        close = getattr(node, "close", None)
        if close is not None:
            close()


class Goal:
    """A goal of an action under way."""

    def __init__(self, ros: Ros, action_type: Any, name: str, fields: dict[str, Any]) -> None:
        self.feedback: list[Any] = []
        self._client = ActionClient(ros.tester, action_type, name)
        wait_for(self._client.server_is_ready, f"action {name}")
        sent = self._client.send_goal_async(
            action_type.Goal(**fields), feedback_callback=lambda m: self.feedback.append(m.feedback)
        )
        wait_for(sent.done, f"acceptance by {name}")
        self.handle = sent.result()
        assert self.handle.accepted
        self._result = self.handle.get_result_async()

    def cancel(self) -> None:
        """Ask for cancellation and wait until the request was accepted."""
        asked = self.handle.cancel_goal_async()
        wait_for(asked.done, "answer to the cancel request")
        assert asked.result().goals_canceling

    def result(self, deadline: float = DEADLINE) -> tuple[int, Any]:
        """Wait for status and result."""
        wait_for(self._result.done, "result of the action", deadline)
        answer = self._result.result()
        self._client.destroy()
        return answer.status, answer.result


def wait_for(condition: Callable[[], Any], what: str, deadline: float = DEADLINE) -> None:
    """Wait until `condition` holds; fail naming `what` when it does not in time."""
    end = time.monotonic() + deadline
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {deadline:g} s: {what}")
        time.sleep(0.01)
