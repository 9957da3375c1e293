# SPDX-License-Identifier: Apache-2.0
"""The seam for many machines: processes of this one, and a dask cluster that loses a worker in the middle."""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rbdo.dispatch import DispatchSettings, evaluate_all
from cwmav_rbdo.evaluation import Request, Responses
from cwmav_rbdo.executors import ExecutorEvaluator, ProcessEvaluator, problem_evaluator
from cwmav_rbdo.problem import parse_problem
from cwmav_rbdo.study import run_study
from cwmav_rbdo.tasks import evaluate_task, task_text
from support.ratio_bowl import small_problem

BRANIN = {
    "id": "branin",
    "kind": "global",
    "design": [{"name": "x", "lo": -5, "hi": 10}, {"name": "y", "lo": 0, "hi": 15}],
    "objective": "(y-5.1/(4*pi**2)*x**2+5/pi*x-6)**2+10*(1-1/(8*pi))*cos(x)+10",
    "max_true_evaluations": 40,
}
SLOW = {
    "id": "slow",
    "kind": "global",
    "design": [{"name": "x", "lo": 0, "hi": 100}],
    "objective": "python:support.slow_functions:patient",
    "max_true_evaluations": 40,
}


def requests(values):
    return [
        Request(k, np.array([v], dtype=float), np.array([v], dtype=float), "initial")
        for k, v in enumerate(values)
    ]


def answers_of(evaluator, values, **settings):
    answers = {}
    try:
        evaluate_all(requests(values), evaluator, DispatchSettings(**settings), answers.__setitem__)
    finally:
        evaluator.close()
    return answers


def test_any_executor_will_do():
    pool = ThreadPoolExecutor(3)
    found = answers_of(ExecutorEvaluator(pool, lambda x: Responses((float(x[0]) ** 2,)), 3), [1, 2, 3, 4])
    assert [found[k].outcome.values for k in range(4)] == [(1.0,), (4.0,), (9.0,), (16.0,)]


def test_a_task_is_the_evaluation_of_the_study():
    problem = parse_problem(BRANIN, "test")
    outcome = evaluate_task(task_text(problem), (np.pi, 2.275))
    assert outcome.values[0] == pytest.approx(0.397887, abs=1e-6)


def test_processes_give_the_result_of_this_process():
    problem = parse_problem(BRANIN, "test")
    alone = run_study(problem, seed=1)
    spread = run_study(replace(problem, dispatch=DispatchSettings(workers=2)), seed=1)
    assert spread.design == alone.design
    assert spread.true_evaluations == alone.true_evaluations


def test_process_that_dies_or_hangs_costs_an_attempt_and_nothing_else():
    evaluator = ProcessEvaluator(parse_problem(SLOW, "test"), 2)
    found = {}
    # 13 kills its own process, 99 sleeps for an hour, the others answer at once.
    for values, patience in (([1, 13, 2], 120.0), ([99, 3], 12.0)):
        settings = DispatchSettings(attempts=1, timeout=patience)
        batch = requests(values)
        evaluate_all(
            batch, evaluator, settings, lambda k, answer, batch=batch: found.update({batch[k].x[0]: answer})
        )
    evaluator.close()
    assert [found[x].outcome and found[x].outcome.values[0] for x in (1, 2, 3)] == [1.0, 2.0, 3.0]
    assert "ended by signal 9" in found[13].note
    assert "no answer within 12 s" in found[99].note


def test_wing_study_names_its_evaluator():
    with pytest.raises(InputError, match="evaluate: ros needs the nodes"):
        problem_evaluator(small_problem())


def test_cluster_that_is_not_there_is_named():
    pytest.importorskip("distributed")
    problem = parse_problem(BRANIN | {"dispatch": {"cluster": "no-scheme:at all"}}, "test")
    with pytest.raises(InputError, match="dispatch.cluster: no scheduler answers at no-scheme:at all"):
        problem_evaluator(problem)


@pytest.mark.filterwarnings("ignore")  # the cluster's own clean-up after a killed worker
def test_cluster_loses_a_worker_in_the_middle():
    distributed = pytest.importorskip("distributed")
    problem = parse_problem(SLOW, "test")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        evaluator = problem_evaluator(
            replace(problem, dispatch=DispatchSettings(cluster=cluster.scheduler_address))
        )
        assert evaluator.workers == 2
        killed = []

        def kill_one(number, answer):
            if not killed:
                with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
                    busy = next(iter(client.run(os.getpid).values()))
                killed.append(busy)
                os.kill(busy, signal.SIGKILL)
            got[number] = answer

        got = {}
        begin = time.monotonic()
        evaluate_all(requests([50, 51, 52, 53, 54, 55]), evaluator, DispatchSettings(timeout=60), kill_one)
        evaluator.close()
    assert killed
    assert {k: a.outcome.values[0] for k, a in got.items()} == {k: 50.0 + k for k in range(6)}
    assert time.monotonic() - begin < 60
