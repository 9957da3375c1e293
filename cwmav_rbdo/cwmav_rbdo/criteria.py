# SPDX-License-Identifier: Apache-2.0
"""When the accelerated loop may stop: criteria CC1 (Eq. 12) and CC2 (Eq. 13), and the requirement itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from cwmav_common.settings import setting


@dataclass(frozen=True)
class CriteriaSettings:
    """Thresholds; the defaults are the paper's."""

    c1: float = setting(
        0.02, "CC1: largest relative error at the optimum, two iterations running", gt=0, lt=1
    )
    c2: float = setting(0.03, "CC2: largest relative change of the optimal prediction", gt=0, lt=1)
    promise: float = setting(
        0.005,
        "method default: largest expected improvement anywhere, relative to the optimum, that is none",
        gt=0,
        lt=1,
    )
    extra_confirmations: int = setting(0, "further iterations that must hold before stopping", ge=0, le=10)


class Row(Protocol):
    """What the criteria look at in one iteration."""

    @property
    def prediction(self) -> float:
        """Predicted at the optimum."""
        ...

    @property
    def response(self) -> float:
        """Evaluated there; NaN when it could not be."""
        ...

    @property
    def feasible(self) -> bool:
        """Whether the requirement holds."""
        ...

    @property
    def certain(self) -> bool:
        """Whether the whole band that the surrogate's error leaves on the reliability agrees with that."""
        ...

    @property
    def promise(self) -> float:
        """Largest expected improvement relative to the prediction; NaN where it was not asked for."""
        ...


@dataclass(frozen=True)
class Verdict:
    """Which criteria hold after an iteration; `converged` when the loop may stop."""

    error_small: bool
    change_small: bool
    feasible: bool
    converged: bool


def relative_error(prediction: float, response: float) -> float:
    """Error of the prediction at the optimum, Eq. 12; infinite where the response is zero."""
    return abs(prediction - response) / abs(response) if response != 0 else float("inf")


def relative_change(now: float, before: float) -> float:
    """Change of the optimal prediction between two iterations, Eq. 13."""
    return abs(now - before) / abs(before) if before != 0 else float("inf")


def mean_square_error(rows: Sequence[Row]) -> float:
    """Mean square of prediction minus response over the rows with a response, Eq. 10; NaN without any."""
    squares = [(row.prediction - row.response) ** 2 for row in rows if math.isfinite(row.response)]
    return sum(squares) / len(squares) if squares else math.nan


def judge(rows: Sequence[Row], settings: CriteriaSettings, strict: bool = False) -> Verdict:
    """Judge the last iteration.

    `strict` asks, beside the paper's criteria, that the surrogate's own error cannot overturn the reliability
    and that twice running no better design was to be expected elsewhere.

    CC1 asks for the error of this and the previous iteration, so nothing converges before the second. An
    iteration whose optimum could not be evaluated has a NaN response and never satisfies CC1.
    """
    verdict = _hold(rows, settings, strict)
    needed = range(settings.extra_confirmations)
    confirmed = all(_hold(rows[: len(rows) - 1 - k], settings, strict).converged for k in needed)
    return Verdict(
        verdict.error_small, verdict.change_small, verdict.feasible, verdict.converged and confirmed
    )


def _hold(rows: Sequence[Row], settings: CriteriaSettings, strict: bool) -> Verdict:
    if not rows:
        return Verdict(False, False, False, False)
    feasible = rows[-1].feasible
    if len(rows) < 2:
        return Verdict(False, False, feasible, False)
    now, before = rows[-1], rows[-2]
    cc1 = all(relative_error(row.prediction, row.response) <= settings.c1 for row in (now, before))
    cc2 = relative_change(now.prediction, before.prediction) <= settings.c2
    sure = not strict or (now.certain and not any(row.promise > settings.promise for row in (now, before)))
    return Verdict(cc1, cc2, feasible, cc1 and cc2 and feasible and sure)
