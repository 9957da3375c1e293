# SPDX-License-Identifier: Apache-2.0
"""Ask and tell around an algorithm that is written top to bottom as a generator.

The algorithm yields batches of points and receives their answers; whoever drives it asks for the points that
are due, evaluates them in any order and on any machine, and tells the answers. Between the two sits the
journal.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rbdo.evaluation import Answer, Request
from cwmav_rbdo.journal import Journal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """A point the algorithm wants evaluated, in the units of the problem, and why."""

    x: Array
    reason: str


@dataclass(frozen=True)
class Told:
    """What the algorithm receives: where was actually evaluated and with what outcome (None: excluded)."""

    x: Array
    outcome: Any
    note: str = ""


Algorithm = Generator[Sequence[Point], list[Told], None]


class AskTell:
    """Drives one algorithm.

    Parameters
    ----------
    algorithm : generator that yields sequences of points and is sent lists of answers
    journal : records everything; may already hold answers
    to_point : turns a design into what evaluators receive
    """

    def __init__(self, algorithm: Algorithm, journal: Journal, to_point: Callable[[Array], Array]) -> None:
        self._algorithm = algorithm
        self._journal = journal
        self._to_point = to_point
        self._batch: list[Request] | None = None
        self._next_id = 0
        self.done = False

    def ask(self) -> list[Request]:
        """Give the requests that are due and unanswered; none when the algorithm has ended.

        Computing the next batch happens here, so a call may take seconds.
        """
        while not self.done:
            if self._batch is None:
                self._advance(None)
                continue
            due = [request for request in self._batch if self._journal.answer(request.id) is None]
            if due:
                return due
            self._advance([self._told(request) for request in self._batch])
        return []

    def tell(self, number: int, answer: Answer) -> None:
        """Answer one request of the current batch; a second answer to the same request is ignored.

        Raises
        ------
        InputError
            No such request is open, or the outcome is not usable: it belongs in ``Answer(None, reason)``.
        """
        if self._batch is None or number not in {request.id for request in self._batch}:
            raise InputError(f"request {number} is not open")
        if answer.outcome is not None and answer.outcome.defect():
            raise InputError(f"request {number}: {answer.outcome.defect()}")
        self._journal.record(number, answer)

    def _advance(self, told: list[Told] | None) -> None:
        try:
            points = next(self._algorithm) if told is None else self._algorithm.send(told)
        except StopIteration:
            self.done = True
            self._batch = []
            return
        self._batch = [self._request(point) for point in points]

    def _request(self, point: Point) -> Request:
        number = self._next_id
        self._next_id += 1
        x = self._journal.request(number, np.asarray(point.x, dtype=float), point.reason)
        return Request(number, x, self._to_point(x), point.reason)

    def _told(self, request: Request) -> Told:
        answer = self._journal.answer(request.id) or Answer(None, "never answered")
        return Told(request.x, answer.outcome, answer.note)
