# SPDX-License-Identifier: Apache-2.0
"""Sends requests to an evaluator, several at once, and deals with those that fail, hang or return nonsense.

An evaluator is anything with ``submit(point) -> Future``: local processes (:mod:`cwmav_rbdo.evaluators`), ROS
services, a cluster. It does not have to be reliable. An attempt that raises, exceeds the time limit or gives
a number that is not finite is repeated; after the last attempt the point is answered with None and the
reasons, and the loop goes on without it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures import CancelledError as FutureCancelled
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import CancelledError, InputError
from cwmav_common.settings import setting
from cwmav_rbdo.evaluation import Answer, Outcome, Request

_POLL = 0.2  # s, longest time before a cancellation is noticed


class Evaluator(Protocol):
    """Answers points; `workers` is how many it can work on at the same time."""

    @property
    def workers(self) -> int:
        """How many points it can work on at the same time."""
        ...

    def submit(self, point: NDArray[np.float64]) -> Future[Any]:
        """Start one evaluation; the future gives an :class:`~cwmav_rbdo.evaluation.Outcome` or raises."""
        ...

    def close(self) -> None:
        """Give back processes and connections."""
        ...


@dataclass(frozen=True)
class DispatchSettings:
    """Patience with evaluations."""

    attempts: int = setting(3, "attempts at one point before it is excluded", ge=1, le=20)
    timeout: float = setting(7200.0, "longest time for one attempt", unit="s", gt=0)
    workers: int = setting(
        1, "processes for the functions of a general problem; 1: none beside this one", ge=1, le=1024
    )
    cluster: str = setting("", "address of a dask.distributed scheduler that evaluates, tcp://host:8786")


@dataclass
class _Attempt:
    request: Request
    deadline: float
    number: int
    failures: list[str] = field(default_factory=list)


def evaluate_all(
    requests: Sequence[Request],
    evaluator: Evaluator,
    settings: DispatchSettings,
    on_answer: Callable[[int, Answer], None],
    *,
    cancelled: Callable[[], bool] = lambda: False,
) -> None:
    """Evaluate all requests and report each answer as soon as it is there.

    Parameters
    ----------
    requests : points to evaluate
    evaluator : who evaluates
    settings : attempts and time limit
    on_answer : called with the request's number and its answer, in order of completion
    cancelled : asked about five times a second

    Raises
    ------
    CancelledError
        `cancelled` became true; running evaluations are abandoned.
    InputError
        The evaluator calls the point itself wrong; repeating it cannot help and the run cannot go on.
    """
    waiting = [_Attempt(request, 0.0, 1) for request in requests]
    running: dict[Future[Any], _Attempt] = {}
    try:
        while waiting or running:
            if cancelled():
                raise CancelledError("cancelled while points were being evaluated")
            while waiting and len(running) < max(1, evaluator.workers):
                attempt = waiting.pop(0)
                attempt.deadline = time.monotonic() + settings.timeout
                running[_submit(evaluator, attempt.request)] = attempt
            done, _ = wait(running, timeout=_POLL, return_when=FIRST_COMPLETED)
            now = time.monotonic()
            late = {f for f, attempt in running.items() if f not in done and now > attempt.deadline}
            for future in done | late:
                attempt = running.pop(future)
                outcome, failure = _harvest(future, settings.timeout)
                if not failure:
                    on_answer(attempt.request.id, Answer(outcome, _note(attempt), attempt.number))
                    continue
                attempt.failures.append(f"attempt {attempt.number}: {failure}")
                if attempt.number >= settings.attempts:
                    on_answer(attempt.request.id, Answer(None, _note(attempt), attempt.number))
                else:
                    attempt.number += 1
                    waiting.append(attempt)
    finally:
        for future in running:
            future.cancel()


def _submit(evaluator: Evaluator, request: Request) -> Future[Any]:
    """Submit; an evaluator that refuses at once is one whose future failed."""
    try:
        return evaluator.submit(request.point)
    except InputError:
        raise
    except Exception as error:
        future: Future[Any] = Future()
        future.set_exception(error)
        return future


def _harvest(future: Future[Any], timeout: float) -> tuple[Outcome | None, str]:
    """Give the outcome, or None and what went wrong."""
    if not future.done():
        future.cancel()
        return None, f"no answer within {timeout:g} s"
    try:
        outcome = future.result()
    except InputError:
        raise
    except FutureCancelled:
        return None, "the evaluator dropped it"
    except Exception as error:
        return None, f"{type(error).__name__}: {' '.join(str(error).split())}"
    defect = outcome.defect()
    return (None, defect) if defect else (outcome, "")


def _note(attempt: _Attempt) -> str:
    return "; ".join(attempt.failures)
