# SPDX-License-Identifier: Apache-2.0
import math
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest

from cwmav_common.errors import CancelledError, InputError
from cwmav_rbdo.dispatch import DispatchSettings, evaluate_all
from cwmav_rbdo.evaluation import Evaluation, Request

GOOD = Evaluation(0.1, 0.001, 0.9, 0.001)


def requests(n):
    return [Request(k, np.array([float(k)]), np.array([float(k)]), "initial") for k in range(n)]


class Script:
    """Does to the k-th submission of a point what the script of that point says at place k."""

    def __init__(self, script, workers=2):
        self.workers = workers
        self.script = {k: list(v) for k, v in script.items()}
        self.submitted = []

    def submit(self, point):
        number = int(point[0])
        self.submitted.append(number)
        step = self.script[number].pop(0) if self.script.get(number) else GOOD
        future = Future()
        if step == "hang":
            return future
        if isinstance(step, Exception):
            future.set_exception(step)
        else:
            future.set_result(step)
        return future

    def close(self):
        pass


def collect(evaluator, n, **settings):
    answers = {}
    evaluate_all(requests(n), evaluator, DispatchSettings(**settings), answers.__setitem__)
    return answers


def test_every_request_is_answered_once():
    evaluator = Script({})
    answers = collect(evaluator, 5)
    assert sorted(answers) == [0, 1, 2, 3, 4]
    assert all(a.outcome == GOOD and a.attempts == 1 for a in answers.values())
    assert sorted(evaluator.submitted) == [0, 1, 2, 3, 4]


def test_failure_is_repeated_then_succeeds_and_the_note_keeps_the_reason():
    answers = collect(Script({1: [RuntimeError("blew up"), GOOD]}), 3)
    assert answers[1].outcome == GOOD
    assert answers[1].attempts == 2
    assert "attempt 1: RuntimeError: blew up" in answers[1].note


def test_after_the_last_attempt_the_point_is_excluded_with_all_reasons():
    nan = Evaluation(math.nan, 0.0, 1.0, 0.0)
    answers = collect(Script({0: [RuntimeError("a"), nan, ValueError("b")]}), 2, attempts=3)
    assert answers[0].outcome is None
    for text in ("attempt 1: RuntimeError: a", "attempt 2: lift is nan", "attempt 3: ValueError: b"):
        assert text in answers[0].note
    assert answers[1].outcome == GOOD


def test_hanging_attempt_is_given_up_after_the_time_limit_and_cancelled():
    class Hanging(Script):
        def submit(self, point):
            self.last = super().submit(point)
            return self.last

    evaluator = Hanging({0: ["hang", "hang"]}, workers=1)
    answers = collect(evaluator, 1, attempts=2, timeout=0.05)
    assert answers[0].outcome is None
    assert "no answer within 0.05 s" in answers[0].note
    assert evaluator.last.cancelled()


def test_no_more_than_the_workers_are_busy_at_once():
    lock, busy, most = threading.Lock(), [0], [0]

    def work():
        with lock:
            busy[0] += 1
            most[0] = max(most[0], busy[0])
        time.sleep(0.01)
        with lock:
            busy[0] -= 1
        return GOOD

    class Pool:
        workers = 3

        def __init__(self):
            self.pool = ThreadPoolExecutor(10)

        def submit(self, point):
            return self.pool.submit(work)

        def close(self):
            self.pool.shutdown()

    pool = Pool()
    assert len(collect(pool, 12)) == 12
    pool.close()
    assert most[0] <= 3


def test_cancellation_stops_waiting_and_cancels_what_runs():
    futures = []

    class Endless(Script):
        def submit(self, point):
            futures.append(Future())
            return futures[-1]

    with pytest.raises(CancelledError):
        evaluate_all(
            requests(3), Endless({}), DispatchSettings(), lambda *a: None, cancelled=lambda: len(futures) > 1
        )
    assert all(f.cancelled() for f in futures)


def test_point_that_the_evaluator_calls_wrong_ends_the_run_at_once():
    evaluator = Script({0: [InputError("F 99 Hz is outside 4..30 Hz")]}, workers=1)
    with pytest.raises(InputError, match="F 99 Hz"):
        collect(evaluator, 2)
    assert evaluator.submitted == [0]


def test_evaluator_that_refuses_to_submit_counts_as_a_failed_attempt():
    class Refusing(Script):
        def submit(self, point):
            if not self.submitted:
                self.submitted.append(0)
                raise ConnectionError("no node")
            return super().submit(point)

    answers = collect(Refusing({}), 1)
    assert answers[0].outcome == GOOD
    assert "ConnectionError: no node" in answers[0].note
