# SPDX-License-Identifier: Apache-2.0
"""Heavy work in processes of its own, with progress, questions back, cancellation and survival of a death.

A node has one thread for its callbacks. Whatever takes longer than a moment is handed to a
:class:`WorkerPool`: the function runs in another process as ``function(*arguments, channel)`` and talks
through its :class:`Channel`. A worker that dies (killed, out of memory) fails the one job it had; the next
job gets a new worker.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from cwmav_common.errors import CancelledError, CwmavError, WorkError

_CONTEXT = multiprocessing.get_context("spawn")  # a fork would copy threads and locks of the node
_NICE = 5  # the node itself goes first on a busy machine


class Channel:
    """The worker's end: how a running function reports, asks and hears that it should stop."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._cancel = threading.Event()
        self._numbers = itertools.count()
        self._questions: dict[int, Future[Any]] = {}

    def report(self, value: Any) -> None:
        """Hand a picklable value to the ``on_report`` of the submitter."""
        self.send("report", value)

    def cancelled(self) -> bool:
        """Say whether the submitter wants the work to stop."""
        return self._cancel.is_set()

    def ask(self, question: Any) -> Future[Any]:
        """Put a question to the ``on_question`` of the submitter; the future gives the answer or raises."""
        number, future = next(self._numbers), Future[Any]()
        self._questions[number] = future
        self.send("question", (number, question))
        return future

    def send(self, kind: str, content: Any) -> None:
        """Send one message to the submitter's process."""
        with self._lock:
            self._connection.send((kind, content))

    def renew(self) -> None:
        """Forget the previous job."""
        self._cancel.clear()
        self._questions.clear()

    def hear(self, kind: str, content: Any) -> None:
        """Take a message that concerns the running job."""
        if kind == "cancel":
            self._cancel.set()
            return
        number, answer, error = content
        future = self._questions.pop(number, None)
        if future is not None and not future.done():
            future.set_result(answer) if error is None else future.set_exception(error)


class Job:
    """One submitted piece of work; `future` gives its result."""

    def __init__(
        self,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        on_report: Callable[[Any], None],
        on_question: Callable[[Any], Future[Any]] | None,
    ) -> None:
        self.work = (function, arguments)
        self.on_report = on_report
        self.on_question = on_question
        self.future: Future[Any] = Future()
        self.worker: _Worker | None = None
        self.cancel_requested = False

    def cancel(self) -> None:
        """Ask the work to stop; the future then raises :class:`CancelledError`, sooner or later."""
        self.cancel_requested = True
        worker = self.worker
        if worker is not None:
            worker.send("cancel", None)

    def abandon(self) -> None:
        """End the process that does the work, for work that does not ask whether it should stop."""
        self.cancel()
        worker = self.worker
        if worker is not None and worker.job is self:
            worker.end()


class WorkerPool:
    """Up to `workers` processes, started when first needed and kept.

    Callbacks (`on_report`, `on_question`, those of the futures) run in threads of the pool.
    """

    def __init__(self, workers: int, name: str = "worker") -> None:
        self.workers = workers
        self.name = name
        self._lock = threading.RLock()
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []
        self._waiting: deque[Job] = deque()
        self._closed = False
        self.deaths = 0

    @property
    def running(self) -> int:
        """Jobs that are being worked on."""
        return len(self._busy)

    @property
    def waiting(self) -> int:
        """Jobs that wait for a worker."""
        return len(self._waiting)

    def submit(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        on_report: Callable[[Any], None] = lambda value: None,
        on_question: Callable[[Any], Future[Any]] | None = None,
    ) -> Job:
        """Run ``function(*arguments, channel)`` in a worker; both must be picklable."""
        job = Job(function, arguments, on_report, on_question)
        with self._lock:
            if self._closed:
                raise WorkError("the worker pool is closed")
            self._waiting.append(job)
        self._dispatch()
        return job

    def close(self, patience: float = 1.0) -> None:
        """Cancel everything, wait `patience` seconds for it to stop, then end the processes."""
        with self._lock:
            self._closed = True
            waiting, busy = list(self._waiting), list(self._busy)
            self._waiting.clear()
        for job in waiting:
            job.future.set_exception(CancelledError("cancelled before it started"))
        for worker in busy:
            if worker.job is not None:
                worker.job.cancel()
        for worker in busy:
            if worker.job is not None:
                with suppress(Exception):
                    worker.job.future.exception(timeout=patience)
        with self._lock:
            workers = [*self._idle, *self._busy]
        for worker in workers:
            worker.end()

    def _dispatch(self) -> None:
        while True:
            with self._lock:
                if self._closed or not self._waiting or len(self._busy) >= self.workers:
                    return
                job = self._waiting.popleft()
                if job.cancel_requested:
                    job.future.set_exception(CancelledError("cancelled before it started"))
                    continue
                worker = self._idle.pop() if self._idle else _Worker(self)
                self._busy.append(worker)
            worker.begin(job)

    def release(self, worker: _Worker, alive: bool) -> None:
        """Take a worker back after its job, or after its death."""
        with self._lock:
            for group in (self._busy, self._idle):
                if worker in group:
                    group.remove(worker)
            if alive:
                self._idle.append(worker)
            elif not self._closed:
                self.deaths += 1
        self._dispatch()


class _Worker:
    """The submitter's end of one process."""

    def __init__(self, pool: WorkerPool) -> None:
        self._pool = pool
        self.job: Job | None = None
        self._lock = threading.Lock()
        ours, theirs = _CONTEXT.Pipe()
        self._connection: Connection = ours
        self._process = _CONTEXT.Process(target=_serve, args=(theirs,), name=pool.name, daemon=True)
        _start_deaf(self._process)
        theirs.close()
        self._reader = threading.Thread(target=self._read, name=f"{pool.name} reader", daemon=True)
        self._reader.start()

    def begin(self, job: Job) -> None:
        self.job = job
        job.worker = self
        try:
            work = pickle.dumps(job.work)
        except Exception as error:
            self._finish(
                None, WorkError(f"the work cannot be handed to another process ({error})"), alive=True
            )
            return
        self.send("work", work)
        if job.cancel_requested:
            self.send("cancel", None)

    def send(self, kind: str, content: Any) -> None:
        with self._lock, suppress(OSError, ValueError):  # of a dead worker, which the reader notices
            self._connection.send((kind, content))

    def end(self) -> None:
        self._process.terminate()
        self._process.join(timeout=5.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(timeout=5.0)

    def _read(self) -> None:
        try:
            while True:
                kind, content = self._connection.recv()
                self._take(kind, content)
        except (EOFError, OSError):
            self._process.join(timeout=5.0)
            code = self._process.exitcode
            died = f"by signal {-code}" if code is not None and code < 0 else f"with status {code}"
            self._finish(
                None, WorkError(f"the worker process ended {died} before its work was done"), alive=False
            )

    def _take(self, kind: str, content: Any) -> None:
        job = self.job
        if job is None:
            return
        if kind == "report":
            job.on_report(content)
        elif kind == "question":
            self._answer(job, *content)
        else:
            result, error = content
            self._finish(result, error, alive=True)

    def _answer(self, job: Job, number: int, question: Any) -> None:
        if job.on_question is None:
            self.send("answer", (number, None, WorkError("nobody answers questions here")))
            return

        def pass_on(future: Future[Any]) -> None:
            if future.cancelled():
                self.send("answer", (number, None, CancelledError("the question was dropped")))
                return
            error = future.exception()
            self.send("answer", (number, None if error else future.result(), error))

        job.on_question(question).add_done_callback(pass_on)

    def _finish(self, result: Any, error: BaseException | None, alive: bool) -> None:
        job, self.job = self.job, None
        if job is not None:
            job.worker = None
        self._pool.release(self, alive)
        if job is not None and not job.future.done():
            job.future.set_result(result) if error is None else job.future.set_exception(error)


def _start_deaf(process: Any) -> None:
    """Start a process that never hears Ctrl-C; that reaches the whole group, but the node decides."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()  # inherits the mask of this thread
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection) -> None:
    """Work until the submitter's process goes away."""
    os.nice(_NICE)
    channel = Channel(connection)
    work: deque[bytes] = deque()
    ready = threading.Semaphore(0)
    threading.Thread(target=_listen, args=(connection, channel, work, ready), daemon=True).start()
    while True:
        ready.acquire()
        channel.send("done", _run(work.popleft(), channel))


def _listen(connection: Connection, channel: Channel, work: deque[bytes], ready: threading.Semaphore) -> None:
    try:
        while True:
            kind, content = connection.recv()
            if kind == "work":
                channel.renew()
                work.append(content)
                ready.release()
            else:
                channel.hear(kind, content)
    except (EOFError, OSError):
        os._exit(0)  # the submitter is gone: nobody wants the result


def _run(work: bytes, channel: Channel) -> tuple[Any, BaseException | None]:
    try:
        function, arguments = pickle.loads(work)  # noqa: S301 - from our own parent process
        return function(*arguments, channel), None
    except CwmavError as error:
        return None, error
    except Exception as error:
        traceback.print_exc()
        return None, WorkError(f"{type(error).__name__}: {error}")
