# SPDX-License-Identifier: Apache-2.0
"""Calls of services whose node may be restarted while it works on the answer.

A request that a node took with it when it died is never answered, and the middleware does not say so: a
killed process keeps its place in the graph for a while. Every node of the suite therefore tells on
``/diagnostics`` which start of it is speaking; when that changes, or the service vanishes and comes back,
what was asked before is asked again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from cwmav_common.errors import WorkError
from cwmav_common.ros.calls import CallQueue
from cwmav_common.ros.diagnostics import INSTANCE

_WATCH = 0.5  # s
_SETTLE = 1.0  # s


class Presence:
    """Which start of every node was last heard on ``/diagnostics``."""

    def __init__(self, node: Node) -> None:
        self._instances: dict[str, str] = {}
        self._subscription = node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 50)

    def instance(self, node_name: str) -> str:
        """Identify the running start of a node; empty while it has not been heard."""
        return self._instances.get(node_name, "")

    def _take(self, array: DiagnosticArray) -> None:
        for status in array.status:
            for entry in status.values:
                if entry.key == INSTANCE:
                    self._instances[status.name.partition(":")[0]] = entry.value


@dataclass
class _Call:
    request: Any
    answer: Future[Any]
    since: float
    sent: Any = None
    sent_to: str = ""
    lost: bool = False
    changed: float | None = None


class RemoteService:
    """One service of another node, called from any thread.

    Parameters
    ----------
    node : whose executor does the calls
    service_type, name : the service; the node that offers it is the part of `name` before the last ``/``
    presence : tells restarts
    calls : way into the thread of `node`
    patience : how long a call may find nobody who offers the service [s]
    """

    def __init__(
        self,
        node: Node,
        service_type: Any,
        name: str,
        presence: Presence,
        calls: CallQueue,
        patience: float = 60.0,
    ) -> None:
        self.name = name
        self.repeated = 0
        self._presence, self._post, self._patience = presence, calls.post, patience
        self._owner = name.rpartition("/")[0]
        self._client = node.create_client(service_type, name)
        self._calls: list[_Call] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_WATCH, self._watch, clock=steady)

    @property
    def pending(self) -> int:
        """Calls without an answer."""
        return len(self._calls)

    def call(self, request: Any) -> Future[Any]:
        """Call the service; the future gives the response, or raises WorkError when nobody offers it."""
        call = _Call(request, Future(), time.monotonic())
        self._post(lambda: self._begin(call))
        return call.answer

    def _begin(self, call: _Call) -> None:
        self._calls.append(call)
        if self._client.service_is_ready():
            self._send(call)

    def _send(self, call: _Call) -> None:
        if call.sent is not None:
            self.repeated += 1
            self._client.remove_pending_request(call.sent)
        call.lost, call.changed = False, None
        call.sent_to = self._presence.instance(self._owner)
        call.sent = self._client.call_async(call.request)
        call.sent.add_done_callback(lambda future: self._done(call, future))

    def _done(self, call: _Call, future: Any) -> None:
        if call.sent is not future or call not in self._calls:
            return
        self._calls.remove(call)
        if call.answer.done():
            return
        error = future.exception()
        if error is None:
            call.answer.set_result(future.result())
        else:
            call.answer.set_exception(WorkError(f"{self.name}: {error}"))

    def _watch(self) -> None:
        if not self._calls:
            return
        ready, instance, now = (
            self._client.service_is_ready(),
            self._presence.instance(self._owner),
            time.monotonic(),
        )
        for call in list(self._calls):
            if call.answer.cancelled():
                self._calls.remove(call)
                continue
            if ready:
                call.since = now
                if self._needs_sending(call, instance, now):
                    self._send(call)
                continue
            call.lost = call.sent is not None
            if now - call.since > self._patience:
                self._calls.remove(call)
                call.answer.set_exception(
                    WorkError(f"nobody has offered the service {self.name} for {self._patience:g} s")
                )

    @staticmethod
    def _needs_sending(call: _Call, instance: str, now: float) -> bool:
        if call.sent is None or call.lost:
            return True
        if not call.sent_to:  # sent before the node was first heard: from now on a change can be seen
            call.sent_to = instance
        if call.sent_to == instance:
            call.changed = None
            return False
        # The new start has been heard; its service is matched a little later than its topics.
        call.changed = now if call.changed is None else call.changed
        return now - call.changed >= _SETTLE


def answered(call: Future[Any], take: Callable[[Any], Any]) -> Future[Any]:
    """Give a future of ``take(response)``; a response without success raises its message."""
    result: Future[Any] = Future()

    def pass_on(done: Future[Any]) -> None:
        if result.done():
            return
        try:
            response = done.result()
            if not response.success:
                raise WorkError(response.message)
            result.set_result(take(response))
        except Exception as error:
            result.set_exception(error)

    call.add_done_callback(pass_on)
    drop_with(result, call)
    return result


def drop_with(result: Future[Any], source: Future[Any]) -> None:
    """Cancel `source` when `result`, which is made from it, is cancelled."""
    result.add_done_callback(lambda done: source.cancel() if done.cancelled() else None)
