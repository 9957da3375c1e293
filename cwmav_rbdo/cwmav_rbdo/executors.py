# SPDX-License-Identifier: Apache-2.0
"""Evaluators made of executors: processes of this machine, or the workers of a ``dask.distributed`` cluster.

Anything with the interface of :class:`concurrent.futures.Executor` will do. Retries, time limits and
exclusion are not its business but :mod:`cwmav_rbdo.dispatch`'s.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common import cluster
from cwmav_common.errors import InputError
from cwmav_common.workers import Channel, WorkerPool
from cwmav_rbdo.dispatch import Evaluator
from cwmav_rbdo.evaluators import FormulaEvaluator, wing_evaluator
from cwmav_rbdo.general.variables import evaluated_names
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.problem import Problem
from cwmav_rbdo.tasks import evaluate_task, task_text
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]


class ExecutorEvaluator:
    """Evaluates with an executor.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    function : callable
        ``function(point)`` gives an outcome; it must reach the executor's workers (picklable for processes).
    workers : int or callable
        Points under way at the same time, or a function that says how many there may be now.
    """

    def __init__(
        self, executor: Executor, function: Callable[[Array], Any], workers: int | Callable[[], int]
    ) -> None:
        self._executor, self._function = executor, function
        self._workers = workers if callable(workers) else lambda: workers

    @property
    def workers(self) -> int:
        """Points under way at the same time."""
        return max(1, self._workers())

    def submit(self, point: Array) -> Future[Any]:
        """Start one evaluation."""
        return self._executor.submit(self._function, point)

    def close(self) -> None:
        """Let the executor go; evaluations that have not started are dropped."""
        self._executor.shutdown(wait=False, cancel_futures=True)


class ProcessEvaluator:
    """Evaluates a problem in processes of this machine.

    A process that dies fails the point it had, and the next one starts; a point that is given up for lateness
    ends its process, so that a function that hangs occupies nothing.
    """

    def __init__(self, problem: Problem, workers: int) -> None:
        self._text = task_text(problem)
        self._pool = WorkerPool(workers, "cwmav_rbdo evaluation")

    @property
    def workers(self) -> int:
        """Processes."""
        return self._pool.workers

    def submit(self, point: Array) -> Future[Any]:
        """Start one evaluation; cancelling the future ends its process."""
        answer: Future[Any] = Future()
        job = self._pool.submit(_in_worker, self._text, tuple(point.tolist()))

        def take(done: Future[Any]) -> None:
            if not answer.done():
                error = done.exception()
                answer.set_result(done.result()) if error is None else answer.set_exception(error)

        job.future.add_done_callback(take)
        answer.add_done_callback(lambda future: job.abandon() if future.cancelled() else None)
        return answer

    def close(self) -> None:
        """End the processes."""
        self._pool.close(patience=0.0)


class ClusterEvaluator:
    """Evaluates a problem on a ``dask.distributed`` cluster.

    The scheduler gives the points of a lost worker to the others. The suite has to be installed where the
    workers run.

    Parameters
    ----------
    problem : sent to the workers as text, so nothing but the suite has to be there
    address : of the scheduler, such as ``tcp://host:8786``

    Raises
    ------
    InputError
        The package is not installed here, or nobody answers at the address.
    """

    def __init__(self, problem: Problem, address: str) -> None:
        self._text = task_text(problem)
        self._client = cluster.connect(address, "dispatch.cluster")
        self._executor = self._client.get_executor(pure=False)

    @property
    def workers(self) -> int:
        """Threads of all workers there now; one while there is none, so that points wait for the first."""
        return cluster.threads(self._client)

    def submit(self, point: Array) -> Future[Any]:
        """Start one evaluation; cancelling the future cancels the task."""
        future: Future[Any] = self._executor.submit(evaluate_task, self._text, tuple(point.tolist()))
        return future

    def close(self) -> None:
        """Leave the cluster, which stays."""
        self._client.close()


def problem_evaluator(problem: Problem) -> Evaluator:
    """Make the evaluator that a problem asks for.

    Raises
    ------
    InputError
        It asks for ROS, which only a node or the command line can give, or for a cluster that is not there.
    """
    if problem.dispatch.cluster:
        return ClusterEvaluator(problem, problem.dispatch.cluster)
    if not isinstance(problem, GeneralProblem):
        return wing_evaluator(problem)
    if problem.dispatch.workers > 1:
        return ProcessEvaluator(problem, problem.dispatch.workers)
    return FormulaEvaluator(problem, evaluated_names(problem))


def with_evaluation(problem: Problem, workers: int, address: str) -> Problem:
    """Change who evaluates a problem, as the command line does; 0 and empty leave it as it is.

    Raises
    ------
    InputError
        A wing study that asks for ROS has no workers of its own to set: the simulation nodes have.
    """
    if address:
        problem = replace(problem, dispatch=replace(problem.dispatch, cluster=address))
    if workers and isinstance(problem, GeneralProblem):
        problem = replace(problem, dispatch=replace(problem.dispatch, workers=workers))
    elif workers and isinstance(problem, WingProblem):
        if problem.evaluate != "local":
            raise InputError(f"--workers {workers}: allowed for general problems and with evaluate: local")
        problem = replace(problem, source=replace(problem.source, workers=workers))
    return problem


def _in_worker(text: str, point: tuple[float, ...], channel: Channel) -> Any:
    return evaluate_task(text, point)
