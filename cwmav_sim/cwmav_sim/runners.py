# SPDX-License-Identifier: Apache-2.0
"""Where the cases of a sweep run: in this process, in several of this machine, or on a cluster."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypedDict

from cwmav_common import cluster
from cwmav_common.errors import WorkError
from cwmav_common.settings import to_mapping
from cwmav_common.workers import Channel, WorkerPool
from cwmav_sim.case import Case, from_dict
from cwmav_sim.result import LiftResult
from cwmav_sim.warm import EndState

_TRIES = 3  # of a case whose process dies


class KeptStates(TypedDict):
    """Where a run starts from and where it leaves its air."""

    start: EndState | None
    keep_state: Path | None


class Runner(Protocol):
    """Runs cases, several at a time."""

    @property
    def workers(self) -> int:
        """Cases under way at the same time."""
        ...

    def submit(self, case: Case) -> Future[LiftResult]:
        """Start a case."""
        ...

    def close(self) -> None:
        """Stop what runs and let go of the workers."""
        ...


class InProcess:
    """One case after the other, in this process.

    Parameters
    ----------
    simulate : callable
        Runs one case.
    """

    workers = 1

    def __init__(self, simulate: Callable[[Case], LiftResult]) -> None:
        self._simulate = simulate

    def submit(self, case: Case) -> Future[LiftResult]:
        """Run a case to its end; a failed run is in the future."""
        future: Future[LiftResult] = Future()
        try:
            future.set_result(self._simulate(case))
        except Exception as error:
            future.set_exception(error)
        return future

    def close(self) -> None:
        """Nothing to stop."""


class Processes:
    """Processes of this machine that share its threads; a case whose process dies is run again.

    Parameters
    ----------
    workers : int
        Number of processes.
    device : str
        Where they compute.
    run : callable
        ``run(case, device, threads, channel)`` does the work; it must be picklable.
    """

    def __init__(self, workers: int, device: str, run: Callable[..., LiftResult] | None = None) -> None:
        self._pool = WorkerPool(workers, "cwmav_sim sweep")
        self._device, self._run = device, run or in_worker
        self._threads = max(1, (os.cpu_count() or 1) // workers)

    @property
    def workers(self) -> int:
        """Processes."""
        return self._pool.workers

    def submit(self, case: Case) -> Future[LiftResult]:
        """Start a case in a process."""
        answer: Future[LiftResult] = Future()
        self._start(case, answer, _TRIES)
        return answer

    def close(self) -> None:
        """End the processes."""
        self._pool.close(patience=0.0)

    def _start(self, case: Case, answer: Future[LiftResult], tries: int) -> None:
        deaths = self._pool.deaths
        job = self._pool.submit(self._run, case, self._device, self._threads)

        def take(done: Future[Any]) -> None:
            error = done.exception()
            if error is None:
                answer.set_result(done.result())
            elif tries > 1 and isinstance(error, WorkError) and self._pool.deaths > deaths:
                self._start(case, answer, tries - 1)
            else:
                answer.set_exception(error)

        job.future.add_done_callback(take)


class Cluster:
    """The workers of a ``dask.distributed`` cluster, which gives the cases of a lost worker to the others.

    The suite has to be installed where the workers run. A case goes there as plain values.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://host:8786``.
    device : str
        Where the workers compute.
    run : callable
        ``run(values, device)`` does the work there; it must be importable there.

    Raises
    ------
    InputError
        The package is not installed here, or nobody answers at the address.
    """

    def __init__(
        self,
        address: str,
        device: str,
        run: Callable[[dict[str, Any], str], LiftResult] | None = None,
    ) -> None:
        self._client = cluster.connect(address, "--cluster")
        self._executor = self._client.get_executor(pure=False)
        self._device, self._run = device, run or run_mapping

    @property
    def workers(self) -> int:
        """Threads of all workers there now."""
        return cluster.threads(self._client)

    def submit(self, case: Case) -> Future[LiftResult]:
        """Start a case on some worker."""
        future: Future[LiftResult] = self._executor.submit(self._run, to_mapping(case), self._device)
        return future

    def close(self) -> None:
        """Leave the cluster, which stays."""
        self._client.close()


def run_mapping(values: dict[str, Any], device: str, states: Path | None = None) -> LiftResult:
    """Run a case given as plain values; the result comes without its history.

    States of finished cases, where they are kept, are in folders named by address in ``states``.
    """
    return _run(from_dict(values), device, None, states)


def in_worker(
    case: Case, device: str, threads: int, channel: Channel, states: Path | None = None
) -> LiftResult:
    """Run a case in a process of a pool; see :func:`run_mapping`."""
    import numba

    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    return _run(case, device, channel.cancelled, states)


def _run(case: Case, device: str, cancelled: Callable[[], bool] | None, states: Path | None) -> LiftResult:
    from cwmav_sim.run import simulate

    result = simulate(case, device=device, cancelled=cancelled, **kept_states(case, states))
    return replace(result, history=None)


def kept_states(case: Case, states: Path | None) -> KeptStates:
    """Return what a simulation needs to start from a kept state and to keep its own."""
    if states is None:
        return {"start": None, "keep_state": None}
    source = case.run.start_from
    start = EndState.read(states / source) if source else None
    return {"start": start, "keep_state": states / case.address()}
