# SPDX-License-Identifier: Apache-2.0
"""Services and actions whose answer comes later, from another process.

With this rclpy, a coroutine that awaits in a service or action callback is resumed on every turn of the
executor, which then never sleeps. Here callbacks return at once and the answer is sent when it is there, so a
node with a run of an hour in progress uses no processor time for it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.service import Service

from cwmav_common.errors import CancelledError
from cwmav_common.ros.calls import CallQueue

Answer = Any


def create_deferred_service(
    node: Node,
    service_type: Any,
    name: str,
    callback: Callable[[Any], Answer | Future[Answer]],
    failure: Callable[[BaseException], Answer],
    calls: CallQueue,
) -> Service:
    """Offer a service.

    Parameters
    ----------
    callback : takes the request; gives the response or a future of it
    failure : turns an exception, raised by `callback` or of its future, into a response
    calls : way into the thread of the node
    """

    def handle(request: Any, _: Any) -> Any:
        try:
            return callback(request)
        except Exception as error:
            return failure(error)

    service = node.create_service(service_type, name, handle)
    send = service.send_response

    def send_now_or_later(response: Any, header: Any) -> None:
        if not isinstance(response, Future):
            send(response, header)
            return

        def send_result(future: Future[Any]) -> None:
            error = CancelledError("cancelled") if future.cancelled() else future.exception()
            answer = failure(error) if error is not None else future.result()
            calls.post(lambda: send(answer, header))

        response.add_done_callback(send_result)

    service.send_response = send_now_or_later
    return service


class DeferredActionServer(ActionServer):
    """Action server that starts goals and is told later how they ended.

    Parameters
    ----------
    start : takes the goal handle; starts the work and returns. Every goal is accepted, because a refusal
        cannot say why; one that makes no sense is finished at once, with the reason in its result
    cancel : takes the goal handle; asks the work to stop
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        name: str,
        *,
        start: Callable[[ServerGoalHandle], None],
        cancel: Callable[[ServerGoalHandle], None],
    ) -> None:
        self._start = start
        super().__init__(
            node,
            action_type,
            name,
            execute_callback=lambda goal: None,
            cancel_callback=lambda goal: self._cancel(goal, cancel),
        )

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Start the work instead of running a coroutine (called by rclpy once the goal is accepted)."""
        del execute_callback
        self._start(goal_handle)

    def finish(self, goal_handle: ServerGoalHandle, outcome: str, result: Any) -> None:
        """End a goal, in the thread of the node; `outcome` is ``succeed``, ``abort`` or ``canceled``."""

        def complete(goal: ServerGoalHandle) -> Any:
            # A goal that nobody asked to cancel cannot become canceled.
            state = "abort" if outcome == "canceled" and not goal.is_cancel_requested else outcome
            getattr(goal, state)()
            return result

        super().notify_execute(goal_handle, complete)

    @staticmethod
    def _cancel(goal: ServerGoalHandle, cancel: Callable[[ServerGoalHandle], None]) -> CancelResponse:
        cancel(goal)
        return CancelResponse.ACCEPT
