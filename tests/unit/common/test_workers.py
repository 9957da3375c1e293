# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future

import pytest

from cwmav_common.errors import CancelledError, InputError, WorkError
from cwmav_common.workers import WorkerPool
from support import ros_fakes as fakes

PATIENCE = 60.0


@pytest.fixture
def pool() -> Iterator[WorkerPool]:
    pool = WorkerPool(1)
    yield pool
    pool.close()


def test_gives_result_and_reports(pool: WorkerPool) -> None:
    reports: list[float] = []
    job = pool.submit(fakes.double, 3.0, on_report=reports.append)
    assert job.future.result(PATIENCE) == 6.0
    assert reports == [3.0]


def test_expected_errors_keep_their_kind_and_text(pool: WorkerPool) -> None:
    with pytest.raises(InputError, match="refused, as asked"):
        pool.submit(fakes.double, fakes.REFUSE).future.result(PATIENCE)
    with pytest.raises(WorkError, match="failed, as asked"):
        pool.submit(fakes.double, fakes.FAIL).future.result(PATIENCE)


def test_a_defect_becomes_a_failure_with_its_name(pool: WorkerPool) -> None:
    with pytest.raises(WorkError, match="ZeroDivisionError: surprise"):
        pool.submit(fakes.surprise).future.result(PATIENCE)


def test_cancel_stops_running_and_waiting_work(pool: WorkerPool) -> None:
    started: Future[float] = Future()
    running = pool.submit(fakes.double, fakes.HANG, on_report=started.set_result)
    waiting = pool.submit(fakes.double, 1.0)
    started.result(PATIENCE)
    assert (pool.running, pool.waiting) == (1, 1)
    waiting.cancel()
    running.cancel()
    with pytest.raises(CancelledError):
        running.future.result(PATIENCE)
    with pytest.raises(CancelledError, match="before it started"):
        waiting.future.result(PATIENCE)


def test_death_of_a_worker_fails_its_job_only(pool: WorkerPool) -> None:
    doomed = pool.submit(fakes.double, fakes.DIE)
    next_one = pool.submit(fakes.double, 4.0)
    with pytest.raises(WorkError, match="ended by signal 9"):
        doomed.future.result(PATIENCE)
    assert next_one.future.result(PATIENCE) == 8.0
    assert pool.deaths == 1


def test_a_worker_is_kept_for_the_next_job(pool: WorkerPool) -> None:
    first = pool.submit(fakes.process_number).future.result(PATIENCE)
    assert pool.submit(fakes.process_number).future.result(PATIENCE) == first


def test_work_can_ask_back(pool: WorkerPool) -> None:
    def answer(question: int) -> Future[int]:
        future: Future[int] = Future()
        future.set_result(question + 1)
        return future

    assert pool.submit(fakes.ask_back, 41, on_question=answer).future.result(PATIENCE) == 42


def test_a_refused_question_raises_where_it_was_asked(pool: WorkerPool) -> None:
    def answer(_: int) -> Future[int]:
        future: Future[int] = Future()
        future.set_exception(WorkError("no idea"))
        return future

    with pytest.raises(WorkError, match="no idea"):
        pool.submit(fakes.ask_back, 41, on_question=answer).future.result(PATIENCE)


def test_close_ends_hanging_work_and_its_process() -> None:
    pool = WorkerPool(2)
    started: Future[float] = Future()
    hanging = pool.submit(fakes.double, fakes.HANG, on_report=started.set_result)
    started.result(PATIENCE)
    pool.close(patience=5.0)
    assert hanging.future.done()
    with pytest.raises(WorkError, match="closed"):
        pool.submit(fakes.double, 1.0)


def test_what_cannot_be_pickled_is_said(pool: WorkerPool) -> None:
    with pytest.raises(WorkError, match="cannot be handed"):
        pool.submit(lambda channel: None).future.result(PATIENCE)
