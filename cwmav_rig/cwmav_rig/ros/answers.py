# SPDX-License-Identifier: Apache-2.0
"""Answers of the rig node that take time: electrical power and scatter, worked out in another process."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from cwmav_msgs.msg import UncertaintyEstimate
from cwmav_msgs.srv import EstimateUncertainty, EvaluatePower
from rclpy.node import Node

from cwmav_common.errors import InputError
from cwmav_common.ros.calls import CallQueue
from cwmav_common.ros.codecs import point_array
from cwmav_common.ros.deferred import create_deferred_service
from cwmav_common.ros.qos import LATCHED
from cwmav_common.workers import Job, WorkerPool
from cwmav_rig.power_model import PowerModel
from cwmav_rig.ros import codecs
from cwmav_rig.ros.settings import RigSettings

POWER_FIDELITIES = ("", "recorded")


class Answers:
    """Offers ``~/evaluate_power`` and ``~/estimate_uncertainty``, and publishes ``~/uncertainty``.

    Parameters
    ----------
    node : who offers
    calls : way into the executor's thread
    settings : gives the parameters as they are now
    recording : gives what is analysed when a request names nothing
    analyse : work of an analysis, in another process: ``analyse(recording, topic_map, window, channel)``
    load_power : work of making the power model: ``load_power(path, topic_map, channel)``

    Attributes
    ----------
    counts
        Requests that were refused, and that failed.
    """

    def __init__(
        self,
        node: Node,
        calls: CallQueue,
        settings: Callable[[], RigSettings],
        recording: Callable[[], str],
        analyse: Callable[..., Any],
        load_power: Callable[..., Any],
    ) -> None:
        self._node, self._calls = node, calls
        self._settings, self._recording = settings, recording
        self._analyse, self._load_power = analyse, load_power
        self.pool = WorkerPool(1, "cwmav_rig worker")
        self.counts = {"refused": 0, "failed": 0}
        self._power: Job | None = None
        self._power_path: tuple[str, str] = ("", "")
        self._uncertainty = node.create_publisher(UncertaintyEstimate, "~/uncertainty", LATCHED)
        create_deferred_service(
            node, EvaluatePower, "~/evaluate_power", self._evaluate_power, self._no_power, calls
        )
        create_deferred_service(
            node,
            EstimateUncertainty,
            "~/estimate_uncertainty",
            self._estimate_uncertainty,
            self._no_uncertainty,
            calls,
        )

    def close(self) -> None:
        """End the work."""
        self.pool.close()

    def power_job(self) -> Job:
        """Give the loading of the power model, started again when its parameters changed."""
        settings = self._settings()
        wanted = (settings.power_model, settings.topic_map)
        if self._power is None or wanted != self._power_path:
            self._power_path = wanted
            self._power = self.pool.submit(self._load_power, *wanted)
        return self._power

    def _evaluate_power(self, request: EvaluatePower.Request) -> Future[EvaluatePower.Response]:
        if request.fidelity not in POWER_FIDELITIES:
            raise InputError(f"fidelity is '{request.fidelity}'; allowed: recorded, or empty")
        point = point_array(request.point)

        def answer(model: PowerModel) -> EvaluatePower.Response:
            return codecs.power_response(model.predict(*point.tolist()))

        return _then(self.power_job().future, answer)

    def _no_power(self, error: BaseException) -> EvaluatePower.Response:
        self._note("evaluate_power", error)
        return codecs.no_power(error)

    def _estimate_uncertainty(self, request: EstimateUncertainty.Request) -> Future[Any]:
        recording = request.recording or self._recording()
        if not recording:
            raise InputError("no recording is named and none is loaded; give 'recording'")
        start, duration = request.window_start, request.window_duration
        if start < 0 or duration < 0:
            raise InputError(f"window_start {start:g} s, window_duration {duration:g} s; allowed: >= 0")
        window = None
        if start > 0 or duration > 0:
            window = (start, start + duration if duration > 0 else float("inf"))
        job = self.pool.submit(self._analyse, recording, self._settings().topic_map, window)
        return _then(job.future, self._report)

    def _report(self, report: Any) -> EstimateUncertainty.Response:
        response = codecs.uncertainty_response(report)
        self._calls.post(lambda: self._uncertainty.publish(response.estimate))
        return response

    def _no_uncertainty(self, error: BaseException) -> EstimateUncertainty.Response:
        self._note("estimate_uncertainty", error)
        return codecs.no_uncertainty(error)

    def _note(self, service: str, error: BaseException) -> None:
        self.counts["refused" if isinstance(error, InputError) else "failed"] += 1
        self._node.get_logger().warning(f"{service}: {error}")


def _then(source: Future[Any], take: Callable[[Any], Any]) -> Future[Any]:
    """Give a future of ``take(result)``; several may wait for one source."""
    result: Future[Any] = Future()

    def pass_on(done: Future[Any]) -> None:
        try:
            result.set_result(take(done.result()))
        except Exception as error:
            result.set_exception(error)

    source.add_done_callback(pass_on)
    return result
