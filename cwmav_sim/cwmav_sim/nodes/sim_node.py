# SPDX-License-Identifier: Apache-2.0
"""The node ``/sim``: lift of a control point, from the bundled table or from a live run."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, Protocol

from cwmav_msgs.action import Simulate
from cwmav_msgs.msg import LiftSample
from cwmav_msgs.srv import EvaluateLift
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from cwmav_common.errors import CancelledError, InputError
from cwmav_common.ros.calls import CallQueue
from cwmav_common.ros.codecs import point_array
from cwmav_common.ros.deferred import DeferredActionServer, create_deferred_service
from cwmav_common.ros.diagnostics import Diagnostics, Health
from cwmav_common.ros.main import main as run_main
from cwmav_common.ros.parameters import Parameters
from cwmav_common.ros.qos import STREAM
from cwmav_common.workers import Job, WorkerPool
from cwmav_sim.case import Case, preset, with_overrides
from cwmav_sim.ros import codecs
from cwmav_sim.ros.live import Cloud, Surface, View, run_live
from cwmav_sim.ros.settings import FIDELITIES, TABLE, SimSettings
from cwmav_sim.run import Progress
from cwmav_sim.table import LiftEstimate, LiftTable

FRAME = "wind"


class Table(Protocol):
    """Lift by interpolation."""

    def lift(self, flapping_frequency: float, angle_of_attack: float, airspeed: float) -> LiftEstimate:
        """Give the lift at F [Hz], AoA [rad], U [m/s]."""
        ...


def load_table(path: str) -> Table:
    """Load a lift table, the bundled one for an empty path."""
    return LiftTable.load(path) if path else LiftTable.bundled()


class SimNode(Node):
    """Adapter between ROS and the simulation.

    Parameters
    ----------
    table : loads the lift table of a path, or the bundled one for an empty path
    live : work of one live run, in another process: ``live(case, store, device, view, channel)``
    options : keyword arguments of the rclpy node
    """

    def __init__(
        self,
        table: Callable[[str], Table] = load_table,
        live: Callable[..., Any] = run_live,
        **options: Any,
    ) -> None:
        super().__init__("sim", **options)
        self._live = live
        self.parameters = Parameters(self, SimSettings, read_only=("lift_table",), on_change=self._on_change)
        self._table = self._load(table)
        self._pool = WorkerPool(self.settings.workers, "cwmav_sim worker")
        self._calls = CallQueue(self)
        self._runs = 0
        self._goals: dict[bytes, Job] = {}
        self._answers = {"answered": 0, "refused": 0, "failed": 0}
        self._lift = self.create_publisher(LiftSample, "~/lift", STREAM)
        self._wings = self.create_publisher(MarkerArray, "~/wings", STREAM)
        self._particles = self.create_publisher(PointCloud2, "~/particles", STREAM)
        create_deferred_service(
            self, EvaluateLift, "~/evaluate_lift", self._evaluate_lift, self._no_lift, self._calls
        )
        self._action = DeferredActionServer(
            self, Simulate, "~/simulate", start=self._start_goal, cancel=self._cancel_goal
        )
        self._diagnostics = Diagnostics(self, "cwmav simulation")
        self._diagnostics.add("work", self._health)

    def _load(self, table: Callable[[str], Table]) -> Callable[[], Table]:
        """Load the table now, which takes seconds; without one the node still simulates, and says why."""
        try:
            loaded = table(self.settings.lift_table)
        except InputError as error:
            reason = str(error)
            self.get_logger().warning(f"no lift table: {reason}")

            def missing() -> Table:
                raise InputError(f"no lift table: {reason}")

            return missing
        return lambda: loaded

    @property
    def settings(self) -> SimSettings:
        """The parameters, one consistent set."""
        return self.parameters.value

    def close(self) -> None:
        """Stop every run and end the processes."""
        self._pool.close()
        self._calls.close()

    def _on_change(self, settings: SimSettings) -> None:
        self._pool.workers = settings.workers

    # --- lift of a point -----------------------------------------------------------------------------------

    def _evaluate_lift(self, request: EvaluateLift.Request) -> Any:
        fidelity = request.fidelity or self.settings.fidelity
        if fidelity not in FIDELITIES:
            raise InputError(f"fidelity is '{fidelity}'; allowed: {', '.join(FIDELITIES)}, or empty")
        point = point_array(request.point)
        if fidelity == TABLE:
            estimate = self._table().lift(*point.tolist())
            self._answers["answered"] += 1
            note = "" if estimate.inside else ", outside of the runs it rests on"
            return EvaluateLift.Response(
                success=True,
                lift=float(estimate.lift),
                lift_std=float(estimate.lift_std),
                source=estimate.source + note,
            )
        answer: Future[EvaluateLift.Response] = Future()
        job = self._submit(self._case(point, fidelity, []), self.settings.publish_particles)
        job.future.add_done_callback(partial(self._answer_lift, answer))
        return answer

    def _answer_lift(self, answer: Future[EvaluateLift.Response], done: Future[Any]) -> None:
        error = done.exception()
        if error is not None:
            answer.set_exception(error)
            return
        result, found = done.result()
        self._answers["answered"] += 1
        answer.set_result(
            EvaluateLift.Response(
                success=True,
                lift=result.mean_lift,
                lift_std=result.lift_std,
                source=codecs.source(result, found),
            )
        )

    def _no_lift(self, error: BaseException) -> EvaluateLift.Response:
        self._answers["refused" if isinstance(error, InputError) else "failed"] += 1
        self.get_logger().warning(f"evaluate_lift: {error}")
        return EvaluateLift.Response(success=False, message=str(error), lift=math.nan, lift_std=math.nan)

    # --- live runs -----------------------------------------------------------------------------------------

    def _case(self, point: Any, name: str, overrides: list[str]) -> Case:
        frequency, angle, airspeed = point.tolist()
        case = with_overrides(preset(name), overrides)
        # A round trip through radians must not move 15 deg, or results would not be found again.
        return case.at(frequency, round(math.degrees(angle), 9), airspeed)

    def _submit(self, case: Case, particles: bool, goal: ServerGoalHandle | None = None) -> Job:
        settings = self.settings
        self._runs += 1
        run = f"{self._runs}-{case.preset}"
        view = View(settings.view_rate, settings.particle_share if particles else 0.0)

        def show(value: Any) -> None:
            header = Header(stamp=self.get_clock().now().to_msg(), frame_id=FRAME)
            if isinstance(value, Progress):
                self._lift.publish(codecs.lift_sample(header, run, case.flapping_frequency, value))
                if goal is not None:
                    goal.publish_feedback(codecs.feedback(value))
            elif isinstance(value, Surface):
                self._wings.publish(codecs.wing_markers(header, value))
            elif isinstance(value, Cloud):
                self._particles.publish(codecs.particle_cloud(header, value))

        return self._pool.submit(
            self._live,
            case,
            settings.store_folder(),
            settings.device,
            view,
            on_report=lambda value: self._calls.post(lambda: show(value)),
        )

    # --- action --------------------------------------------------------------------------------------------

    def _start_goal(self, goal: ServerGoalHandle) -> None:
        request = goal.request
        try:
            name = request.fidelity or self.settings.preset
            if name == TABLE:
                raise InputError(
                    f"fidelity is '{TABLE}'; a live run needs one of: {', '.join(FIDELITIES[1:])}"
                )
            case = self._case(point_array(request.point), name, list(request.overrides))
            particles = request.publish_particles or self.settings.publish_particles
            job = self._submit(case, particles, goal)
        except Exception as error:
            self._end_goal(goal, None, error)
            return
        self._goals[bytes(goal.goal_id.uuid)] = job
        if goal.is_cancel_requested:
            job.cancel()
        job.future.add_done_callback(
            lambda done: self._calls.post(lambda: self._end_goal(goal, *_outcome(done)))
        )

    def _cancel_goal(self, goal: ServerGoalHandle) -> None:
        job = self._goals.get(bytes(goal.goal_id.uuid))
        if job is not None:
            job.cancel()

    def _end_goal(self, goal: ServerGoalHandle, outcome: Any, error: BaseException | None) -> None:
        self._goals.pop(bytes(goal.goal_id.uuid), None)
        if error is None:
            self._answers["answered"] += 1
            self._action.finish(goal, "succeed", codecs.result_message(*outcome))
            return
        cancelled = isinstance(error, CancelledError)
        if not cancelled:
            self._answers["refused" if isinstance(error, InputError) else "failed"] += 1
            self.get_logger().warning(f"simulate: {error}")
        result = Simulate.Result(success=False, message=str(error), lift=math.nan, lift_std=math.nan)
        self._action.finish(goal, "canceled" if cancelled else "abort", result)

    # --- health --------------------------------------------------------------------------------------------

    def _health(self) -> Health:
        running, waiting = self._pool.running, self._pool.waiting
        values = {
            "workers": self._pool.workers,
            "running": running,
            "waiting": waiting,
            "worker deaths": self._pool.deaths,
            **self._answers,
        }
        level = "warn" if self._pool.deaths or self._answers["failed"] else "ok"
        text = f"{running} running, {waiting} waiting" if running or waiting else "idle"
        return Health(text, level, values)


def _outcome(done: Future[Any]) -> tuple[Any, BaseException | None]:
    error = done.exception()
    return (None, error) if error is not None else (done.result(), None)


def main() -> None:
    """Run the node until SIGINT."""
    run_main(SimNode)


if __name__ == "__main__":
    main()
