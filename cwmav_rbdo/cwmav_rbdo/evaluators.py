# SPDX-License-Identifier: Apache-2.0
"""Evaluators that need no ROS: the bundled lift table, live runs in their own processes, formulas of a file.

Lift comes from the simulation, power from the surrogate of rig recordings, as over the services.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import CwmavError, InputError
from cwmav_common.workers import Channel, WorkerPool
from cwmav_rbdo.dispatch import Evaluator
from cwmav_rbdo.evaluation import Evaluation, Responses
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.wing_problem import WingProblem
from cwmav_rig.power_model import PowerModel

Array = NDArray[np.float64]


class TableEvaluator:
    """Answers at once: lift from the bundled table of SPH runs, power from the power surrogate."""

    workers = 1

    def __init__(self, power: PowerModel) -> None:
        from cwmav_sim.table import LiftTable  # deferred: fitting the table takes seconds

        self._table = LiftTable.bundled()
        self._power = power

    def submit(self, point: Array) -> Future[Evaluation]:
        """Look lift and power up at F [Hz], AoA [rad], U [m/s]."""
        f, a, u = point.tolist()
        lift = self._table.lift(f, a, u)
        source = lift.source if lift.inside else f"{lift.source}; outside of the range of the runs"
        return _done(Evaluation(lift.lift, lift.lift_std, *_power(self._power, f, a, u, source)))

    def close(self) -> None:
        """Nothing to give back."""


class LiveEvaluator:
    """Simulates every point with a preset of the solver, `workers` at a time, each in a process of its own.

    Parameters
    ----------
    power : surrogate of the measured power
    preset : resolution of the runs
    workers : runs at the same time
    """

    def __init__(self, power: PowerModel, preset: str, workers: int = 1) -> None:
        from cwmav_sim.case import presets

        if preset not in presets():
            raise InputError(f"source.fidelity is '{preset}'; allowed: table, {', '.join(presets())}")
        self._power = power
        self._preset = preset
        self._pool = WorkerPool(workers, "cwmav_rbdo evaluation")

    @property
    def workers(self) -> int:
        """Runs at the same time."""
        return self._pool.workers

    def submit(self, point: Array) -> Future[Evaluation]:
        """Start a run at F [Hz], AoA [rad], U [m/s]; cancelling the future stops it."""
        f, a, u = point.tolist()
        answer: Future[Evaluation] = Future()
        job = self._pool.submit(_simulate, self._preset, f, a, u)

        def take(done: Future[Any]) -> None:
            if answer.done():
                return
            error = done.exception()
            if error is not None:
                answer.set_exception(error)
                return
            lift, lift_std, source = done.result()
            answer.set_result(Evaluation(lift, lift_std, *_power(self._power, f, a, u, source)))

        job.future.add_done_callback(take)
        answer.add_done_callback(lambda future: job.cancel() if future.cancelled() else None)
        return answer

    def close(self) -> None:
        """Stop the processes."""
        self._pool.close()


class FormulaEvaluator:
    """Evaluates the expensive functions of a general problem in this process."""

    workers = 1

    def __init__(self, problem: GeneralProblem, names: Sequence[str]) -> None:
        self._problem = problem
        self._names = tuple(names)

    def submit(self, point: Array) -> Future[Responses]:
        """Evaluate at a point of the named variables: all constraints, or the objective."""
        rows = {name: np.array([value]) for name, value in zip(self._names, point.tolist(), strict=True)}
        functions = self._problem.functions
        try:
            values = (
                functions.minimised(rows)
                if self._problem.kind == "global"
                else functions.limit_states(rows)[0]
            )
        except CwmavError as error:
            return _failed(error)
        return _done(Responses(tuple(float(v) for v in values)))

    def close(self) -> None:
        """Nothing to give back."""


def wing_evaluator(problem: WingProblem) -> Evaluator:
    """Make the evaluator that ``evaluate`` of the problem asks for.

    Raises
    ------
    InputError
        It asks for ROS, which only a node or the command line can give.
    """
    if problem.evaluate == "ros":
        raise InputError("evaluate: ros needs the nodes; allowed without them: local, table")
    power = power_model(problem)
    if problem.evaluate == "table" or problem.source.fidelity == "table":
        return TableEvaluator(power)
    return LiveEvaluator(power, problem.source.fidelity, problem.source.workers)


def power_model(problem: WingProblem) -> PowerModel:
    """Surrogate of the measured power: of the problem's recordings, or the bundled one."""
    from cwmav_rig.topic_map import load_topic_map

    source = problem.source
    if not source.recordings:
        return PowerModel.load(Path(str(resources.files("cwmav_rig") / "data" / "power_model.json")))
    if len(source.recordings) == 1 and source.recordings[0].endswith(".json"):
        return PowerModel.load(source.recordings[0])
    topic_map = load_topic_map(source.topic_map) if source.topic_map else None
    return PowerModel.from_recordings(source.recordings, topic_map)


def _power(
    model: PowerModel, f: float, a: float, u: float, lift_source: str
) -> tuple[float, float, str, str]:
    power = model.predict(f, a, u)
    return power.power, power.power_std, lift_source, power.source


def _simulate(preset: str, f: float, a: float, u: float, channel: Channel) -> tuple[float, float, str]:
    """One run, in a worker process."""
    from cwmav_sim.case import preset as case_of
    from cwmav_sim.run import simulate

    case = case_of(preset).at(f, math.degrees(a), u)
    result = simulate(case, cancelled=channel.cancelled)
    return result.mean_lift, result.lift_std, result.source()


def _done(value: Any) -> Future[Any]:
    future: Future[Any] = Future()
    future.set_result(value)
    return future


def _failed(error: Exception) -> Future[Any]:
    future: Future[Any] = Future()
    future.set_exception(error)
    return future
