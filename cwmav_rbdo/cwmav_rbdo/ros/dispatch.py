# SPDX-License-Identifier: Apache-2.0
"""Evaluation of points over the services of the simulation and the rig."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
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


@dataclass
class _Simulation:
    """One simulation node as seen from here."""

    name: str
    lift: RemoteService
    parameters: RemoteService
    workers: int = 1

    @property
    def load(self) -> float:
        """Points under way, relative to what it works on at the same time."""
        return self.lift.pending / self.workers


class RosEvaluator:
    """Asks ``~/evaluate_lift`` and ``~/evaluate_power`` for every point; several points may be under way.

    Of several simulation nodes the least busy one is asked, and after a failure another than the one that
    failed at that point.

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

        self._sims = [
            _Simulation(
                name,
                remote(EvaluateLift, f"{name}/evaluate_lift"),
                remote(GetParameters, f"{name}/get_parameters"),
            )
            for name in settings.sims
        ]
        self._power = remote(EvaluatePower, f"{settings.rig}/evaluate_power")
        self._scatter = remote(EstimateUncertainty, f"{settings.rig}/estimate_uncertainty")
        self._failed: dict[tuple[float, ...], str] = {}
        self._begun = 0

    @property
    def workers(self) -> int:
        """How many points the simulation nodes work on at the same time, as last heard."""
        return sum(sim.workers for sim in self._sims)

    @property
    def pending(self) -> int:
        """Answers that are awaited."""
        return sum(sim.lift.pending for sim in self._sims) + self._power.pending

    @property
    def repeated(self) -> int:
        """Requests that had to be sent again because a node was restarted."""
        return sum(sim.lift.repeated for sim in self._sims) + self._power.repeated

    def learn_workers(self) -> Future[int]:
        """Ask the simulation nodes for their numbers of workers; :attr:`workers` holds the sum from then on.

        A node that does not answer counts as one worker, unless none does.
        """
        found: Future[int] = Future()
        waiting, errors = {sim.name for sim in self._sims}, []

        def take(sim: _Simulation, done: Future[Any]) -> None:
            waiting.discard(sim.name)
            error = done.exception()
            if error is not None:
                errors.append(error)
            elif done.result().values:
                sim.workers = max(1, int(done.result().values[0].integer_value))
            if waiting or found.done():
                return
            if len(errors) == len(self._sims):
                found.set_exception(errors[0])
            else:
                found.set_result(self.workers)

        for sim in self._sims:
            call = sim.parameters.call(GetParameters.Request(names=["workers"]))
            call.add_done_callback(partial(take, sim))
        return found

    def submit(self, point: NDArray[np.float64]) -> Future[Evaluation]:
        """Ask for lift and power of a control point (F [Hz], AoA [rad], U [m/s])."""
        message, key = control_point(point), tuple(point.tolist())
        sim = self._choose(key)
        lift = sim.lift.call(EvaluateLift.Request(point=message, fidelity=self._settings.fidelity))
        power = self._power.call(EvaluatePower.Request(point=message))
        result = _both(answered(lift, lambda r: r), answered(power, lambda r: r))
        result.add_done_callback(lambda done: self._remember(key, sim, done))
        return result

    def _choose(self, key: tuple[float, ...]) -> _Simulation:
        others = [sim for sim in self._sims if sim.name != self._failed.get(key)] or self._sims
        self._begun += 1
        # Calls begin in the node's own thread: among equally busy ones, take turns.
        turn = self._begun % len(others)
        return min(others[turn:] + others[:turn], key=lambda sim: sim.load)

    def _remember(self, key: tuple[float, ...], sim: _Simulation, done: Future[Any]) -> None:
        if done.cancelled() or done.exception() is not None:
            self._failed[key] = sim.name
        else:
            self._failed.pop(key, None)

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
