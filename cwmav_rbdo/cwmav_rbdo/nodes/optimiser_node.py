# SPDX-License-Identifier: Apache-2.0
"""The node ``/optimiser``: runs studies and asks the other two nodes for lift, power and scatter."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cwmav_msgs.action import Optimise
from cwmav_msgs.msg import OptimiserIteration
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from cwmav_common.errors import CancelledError, InputError
from cwmav_common.ros.calls import CallQueue
from cwmav_common.ros.deferred import DeferredActionServer
from cwmav_common.ros.diagnostics import Diagnostics, Health
from cwmav_common.ros.main import main as run_main
from cwmav_common.ros.parameters import Parameters
from cwmav_common.ros.qos import LATCHED
from cwmav_common.ros.recorder import Recorder
from cwmav_common.workers import Job, WorkerPool
from cwmav_rbdo.problem import parse_text
from cwmav_rbdo.ros import codecs
from cwmav_rbdo.ros.dispatch import RosEvaluator
from cwmav_rbdo.ros.settings import OptimiserSettings
from cwmav_rbdo.ros.work import AskNoise, AskPoint, AskWorkers, optimise
from cwmav_rbdo.run_folder import RunFolder
from cwmav_rbdo.wing_problem import WingProblem

HEARTBEAT = 2.0  # s between feedbacks while nothing new is known
GRACE = 1.0  # s that the recorder goes on after the end of the study


@dataclass
class _Study:
    """A goal under way."""

    goal: ServerGoalHandle
    problem: WingProblem
    folder: RunFolder
    evaluator: RosEvaluator | None
    recorder: Recorder | None
    job: Job | None = None
    last: OptimiserIteration | None = None

    @property
    def name(self) -> str:
        return self.folder.path.name


class OptimiserNode(Node):
    """Adapter between ROS and the optimisation.

    Parameters
    ----------
    work : a study, in another process: ``work(text, seed, folder, resume, channel)``
    options : keyword arguments of the rclpy node
    """

    def __init__(self, work: Callable[..., Any] = optimise, **options: Any) -> None:
        super().__init__("optimiser", **options)
        self._work = work
        self.parameters = Parameters(self, OptimiserSettings, read_only=("sim", "rig"))
        self._calls = CallQueue(self)
        self._pool = WorkerPool(1, "cwmav_rbdo worker")
        self._evaluator = RosEvaluator(self, self.settings, self._calls)
        self._study: _Study | None = None
        self._counts = {"studies": 0, "failed": 0}
        self._iterations = self.create_publisher(OptimiserIteration, "~/iteration", LATCHED)
        self._action = DeferredActionServer(
            self, Optimise, "~/optimise", start=self._start_goal, cancel=self._cancel_goal
        )
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._heartbeat = self.create_timer(HEARTBEAT, self._beat, clock=self._steady)
        self._diagnostics = Diagnostics(self, "cwmav optimiser")
        self._diagnostics.add("study", self._health)

    @property
    def settings(self) -> OptimiserSettings:
        """The parameters, one consistent set."""
        return self.parameters.value

    def close(self) -> None:
        """Stop the study; its journal stays, so it can be resumed."""
        self._pool.close()
        self._calls.close()
        if self._study is not None and self._study.recorder is not None:
            self._study.recorder.close()

    # --- goals ---------------------------------------------------------------------------------------------

    def _start_goal(self, goal: ServerGoalHandle) -> None:
        try:
            self._study = study = self._prepare(goal)
        except Exception as error:
            self._finish(goal, error)
            return
        self._counts["studies"] += 1
        request = goal.request
        study.job = self._pool.submit(
            self._work,
            request.problem,
            int(request.seed),
            str(study.folder.path),
            bool(request.resume),
            on_report=lambda row: self._calls.post(lambda: self._take_row(study, row)),
            on_question=self._answer,
        )
        if goal.is_cancel_requested:
            study.job.cancel()
        study.job.future.add_done_callback(lambda done: self._calls.post(lambda: self._wind_up(study, done)))
        self._beat()

    def _prepare(self, goal: ServerGoalHandle) -> _Study:
        if self._study is not None:
            raise InputError(f"a study is running ({self._study.name}); cancel it or wait for its end")
        request = goal.request
        problem = parse_text(request.problem)
        if not isinstance(problem, WingProblem):
            raise InputError(
                f"kind is '{problem.kind}'; allowed here: lift_to_power (`cwmav-rbdo run` solves the others)"
            )
        settings = self.settings
        if request.resume:
            folder = RunFolder.open(request.resume)
        else:
            folder = RunFolder.create(settings.run_root, problem.id)
        recorder = self._recorder(folder, settings) if settings.record else None
        return _Study(goal, problem, folder, self._evaluator, recorder)

    def _recorder(self, folder: RunFolder, settings: OptimiserSettings) -> Recorder:
        own = self.get_fully_qualified_name()
        prefixes = tuple(f"{name}/" for name in (*settings.sims, settings.rig, own))

        def wanted(topic: str) -> bool:
            return topic == "/diagnostics" or (topic.startswith(prefixes) and "/_action/" not in topic)

        return Recorder(self, _free(folder.recording), wanted, {"run": folder.path.name})

    def _cancel_goal(self, goal: ServerGoalHandle) -> None:
        study = self._study
        if study is not None and study.goal == goal and study.job is not None:
            study.job.cancel()

    def _wind_up(self, study: _Study, done: Future[Any]) -> None:
        """End the study as soon as what was published last had time to reach the recorder."""

        def end() -> None:
            self.destroy_timer(timer)
            self._end_study(study, done)

        timer = self.create_timer(GRACE if study.recorder else 0.0, end, clock=self._steady)

    def _end_study(self, study: _Study, done: Future[Any]) -> None:
        self._study = None
        if study.recorder is not None:
            study.recorder.close()
        error = done.exception()
        if error is not None:
            self._finish(study.goal, error, str(study.folder.path))
            return
        folder = str(study.folder.path)
        self._action.finish(
            study.goal, "succeed", codecs.result_message(study.problem, done.result(), folder)
        )

    def _finish(self, goal: ServerGoalHandle, error: BaseException, folder: str = "") -> None:
        cancelled = isinstance(error, CancelledError)
        if not cancelled:
            self._counts["failed"] += 1
            self.get_logger().warning(f"optimise: {error}")
        result = Optimise.Result(
            success=False, message=str(error), lift_to_power=math.nan, reliability=math.nan, run_folder=folder
        )
        self._action.finish(goal, "canceled" if cancelled else "abort", result)

    # --- the running study ---------------------------------------------------------------------------------

    def _answer(self, question: Any) -> Future[Any]:
        if isinstance(question, AskPoint):
            return self._evaluator.submit(question.point)
        if isinstance(question, AskWorkers):
            return self._evaluator.learn_workers()
        if isinstance(question, AskNoise):
            return self._evaluator.measure_noise()
        raise TypeError(f"unknown question {question!r}")

    def _take_row(self, study: _Study, row: Any) -> None:
        header = Header(stamp=self.get_clock().now().to_msg())
        study.last = codecs.iteration(header, study.name, study.problem, row)
        self._iterations.publish(study.last)
        self._feed(study, "iteration done")

    def _beat(self) -> None:
        study = self._study
        if study is not None:
            pending = self._evaluator.pending
            self._feed(study, "evaluating points" if pending else "fitting and searching")

    def _feed(self, study: _Study, status: str) -> None:
        feedback = Optimise.Feedback(status=status, pending=self._evaluator.pending)
        if study.last is not None:
            feedback.iteration = study.last
        study.goal.publish_feedback(feedback)

    def _health(self) -> Health:
        evaluator = self._evaluator
        values: dict[str, Any] = {
            **self._counts,
            "pending": evaluator.pending,
            "repeated": evaluator.repeated,
            "worker deaths": self._pool.deaths,
        }
        study = self._study
        if study is None:
            return Health("idle", values=values)
        done = study.last.iteration if study.last is not None else "none"
        return Health(f"running {study.name}, last iteration {done}", values=values)


def _free(path: Path) -> Path:
    """Give `path`, or the next free name beside it when a resumed run has one already."""
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_stem(f"{path.stem}-{number}")
    return candidate


def main() -> None:
    """Run the node until SIGINT."""
    run_main(OptimiserNode)


if __name__ == "__main__":
    main()
