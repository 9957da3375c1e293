# SPDX-License-Identifier: Apache-2.0
"""Evaluation of points over the services of the simulation and the rig."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from threading import Thread
from typing import Any

import numpy as np
import rclpy
from cwmav_msgs.srv import EstimateUncertainty, EvaluateLift, EvaluatePower
from numpy.typing import NDArray
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from cwmav_common.ros.calls import CallQueue
from cwmav_common.ros.codecs import control_point
from cwmav_common.ros.remote import Presence, RemoteService, answered, drop_with
from cwmav_rbdo.evaluation import Evaluation
from cwmav_rbdo.noise import Noise
from cwmav_rbdo.ros.codecs import noise_of
from cwmav_rbdo.ros.settings import OptimiserSettings


class RosEvaluator:
    """Asks ``~/evaluate_lift`` and ``~/evaluate_power`` for every point; several points may be under way.

    Parameters
    ----------
    node : whose executor does the calls; the methods here may be called from any other thread
    settings : names of the nodes, fidelity, patience
    calls : way into the thread of `node`
    """

    def __init__(self, node: Node, settings: OptimiserSettings, calls: CallQueue) -> None:
        self._settings = settings
        presence = Presence(node)

        def remote(service_type: Any, name: str) -> RemoteService:
            return RemoteService(node, service_type, name, presence, calls, settings.patience)

        self._lift = remote(EvaluateLift, f"{settings.sim}/evaluate_lift")
        self._power = remote(EvaluatePower, f"{settings.rig}/evaluate_power")
        self._scatter = remote(EstimateUncertainty, f"{settings.rig}/estimate_uncertainty")
        self._sim_parameters = remote(GetParameters, f"{settings.sim}/get_parameters")
        self._workers = 1

    @property
    def workers(self) -> int:
        """How many points the simulation node works on at the same time, as last heard."""
        return self._workers

    @property
    def pending(self) -> int:
        """Answers that are awaited."""
        return self._lift.pending + self._power.pending

    @property
    def repeated(self) -> int:
        """Requests that had to be sent again because a node was restarted."""
        return self._lift.repeated + self._power.repeated

    def learn_workers(self) -> Future[int]:
        """Ask the simulation node for its number of workers; :attr:`workers` holds it from then on."""
        found: Future[int] = Future()

        def take(done: Future[Any]) -> None:
            error = done.exception()
            if error is not None:
                found.set_exception(error)
                return
            values = done.result().values
            self._workers = max(1, int(values[0].integer_value)) if values else 1
            found.set_result(self._workers)

        self._sim_parameters.call(GetParameters.Request(names=["workers"])).add_done_callback(take)
        return found

    def submit(self, point: NDArray[np.float64]) -> Future[Evaluation]:
        """Ask for lift and power of a control point (F [Hz], AoA [rad], U [m/s])."""
        message = control_point(point)
        lift = self._lift.call(EvaluateLift.Request(point=message, fidelity=self._settings.fidelity))
        power = self._power.call(EvaluatePower.Request(point=message))
        return _both(answered(lift, lambda r: r), answered(power, lambda r: r))

    def measure_noise(self) -> Future[Noise]:
        """Ask the rig for the scatter of the control variables on the recording it has."""
        return answered(self._scatter.call(EstimateUncertainty.Request()), lambda r: noise_of(r.estimate))

    def close(self) -> None:
        """Nothing to give back: services end with the node."""


def _both(lift: Future[Any], power: Future[Any]) -> Future[Evaluation]:
    """Join the two answers of one point; the first failure decides."""
    result: Future[Evaluation] = Future()

    def join(_: Future[Any]) -> None:
        if result.done():
            return
        for part in (lift, power):
            error = part.exception() if part.done() and not part.cancelled() else None
            if error is not None:
                result.set_exception(error)
                return
        if lift.done() and power.done():
            a, b = lift.result(), power.result()
            result.set_result(
                Evaluation(
                    a.lift, a.lift_std, b.power, b.power_std, lift_source=a.source, power_source=b.source
                )
            )

    for part in (lift, power):
        part.add_done_callback(join)
        drop_with(result, part)
    return result


@contextmanager
def ros_evaluator(settings: OptimiserSettings | None = None) -> Iterator[RosEvaluator]:
    """Open an evaluator with a node of its own, for programs that are no node themselves."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("cwmav_rbdo", context=context)
    calls = CallQueue(node)
    evaluator = RosEvaluator(node, settings or OptimiserSettings(), calls)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = Thread(target=executor.spin, name="cwmav_rbdo executor", daemon=True)
    thread.start()
    try:
        evaluator.learn_workers().result()
        yield evaluator
    finally:
        calls.close()
        executor.shutdown(timeout_sec=5.0)
        thread.join(timeout=5.0)
        node.destroy_node()
        context.try_shutdown()
