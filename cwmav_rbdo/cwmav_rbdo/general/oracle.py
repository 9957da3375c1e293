# SPDX-License-Identifier: Apache-2.0
"""Expensive functions as a callable that asks an evaluator, counts, and remembers in the journal."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import CwmavError
from cwmav_rbdo.dispatch import DispatchSettings, Evaluator, evaluate_all
from cwmav_rbdo.evaluation import Answer, Request
from cwmav_rbdo.journal import Journal

Array = NDArray[np.float64]


class BudgetSpentError(CwmavError):
    """A point was asked for beyond the budget."""


@dataclass(frozen=True)
class Answers:
    """Usable points (n, D) with their responses (n, K)."""

    points: Array
    values: Array


class Oracle:
    """Evaluates rows of points.

    Parameters
    ----------
    evaluator : who evaluates
    journal : answers what was answered before, so that an interrupted run continues
    budget : points at most, the excluded ones included
    settings : attempts and time limit of an evaluation
    cancelled : asked while waiting

    Attributes
    ----------
    calls : points asked for; all functions at one point count as one
    excluded : reasons of the points that could not be evaluated
    """

    def __init__(
        self,
        evaluator: Evaluator,
        journal: Journal,
        budget: int,
        settings: DispatchSettings,
        cancelled: Callable[[], bool],
    ) -> None:
        self._evaluator = evaluator
        self._journal = journal
        self._settings = settings
        self._cancelled = cancelled
        self.budget = budget
        self.calls = 0
        self.excluded: list[str] = []

    @property
    def left(self) -> int:
        """Points that may still be asked for."""
        return self.budget - self.calls

    def __call__(self, X: Array, reason: str) -> Answers:
        """Evaluate rows (n, D); what cannot be evaluated is left out and noted.

        Raises
        ------
        BudgetSpentError
            There are more rows than points left; nothing is evaluated.
        """
        if len(X) > self.left:
            raise BudgetSpentError(f"{len(X)} points asked for, {self.left} left of {self.budget}")
        requests = []
        for x in X:
            recorded = self._journal.request(self.calls, np.asarray(x, dtype=float), reason)
            requests.append(Request(self.calls, recorded, recorded, reason))
            self.calls += 1
        open_requests = [r for r in requests if self._journal.answer(r.id) is None]
        if open_requests:
            evaluate_all(
                open_requests,
                self._evaluator,
                self._settings,
                self._journal.record,
                cancelled=self._cancelled,
            )
        return self._collected(requests)

    def _collected(self, requests: Iterable[Request]) -> Answers:
        points, values = [], []
        for request in requests:
            answer = self._journal.answer(request.id) or Answer(None, "never answered")
            if answer.outcome is None:
                self.excluded.append(f"{np.array2string(request.x, precision=5)}: {answer.note}")
            else:
                points.append(request.x)
                values.append(answer.outcome.values)
        return Answers(np.array(points), np.array(values))
