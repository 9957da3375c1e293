# SPDX-License-Identifier: Apache-2.0
"""The accelerated loop of the paper: the best reliable lift-to-power ratio, by ask and tell.

:meth:`AcceleratedLoop._algorithm` is the method, top to bottom. Latin hypercube; surrogates of lift, power
and their ratio; swarm optimum under the reliability constraint (Eqs. 6 and 14); evaluation at the optimum;
criteria (Eqs. 12 and 13); new samples where the Kriging error is largest, in the whole space and in the
moving window (Eq. 11).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_rbdo.ask_tell import Algorithm, AskTell, Point, Told
from cwmav_rbdo.control_scatter import ControlScatter
from cwmav_rbdo.criteria import judge, mean_square_error
from cwmav_rbdo.evaluation import Answer, Evaluation, Request
from cwmav_rbdo.goals import goal_of
from cwmav_rbdo.infill import FIXED_SIZE, State, largest_mse, new_samples
from cwmav_rbdo.journal import Journal
from cwmav_rbdo.lift_to_power import RatioSurrogate
from cwmav_rbdo.noise import Noise
from cwmav_rbdo.optimum import Optimum, reliable_optimum
from cwmav_rbdo.result import Constraint, IterationRow, Result
from cwmav_rbdo.samples import Samples
from cwmav_rbdo.sampling import latin_hypercube
from cwmav_rbdo.surfaces import surface_of
from cwmav_rbdo.window import Window, adapted, moving_window
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]

_BAND = 1.1
"""Failures that the low end of the band may have, relative to those allowed."""


class AcceleratedLoop:
    """One run of the wing study.

    Parameters
    ----------
    problem : what to optimise, with which settings
    noise : scatter of the control variables
    rng : source of every random number; the same generator state gives the same run
    journal : records requests and answers, and answers what it already holds

    Attributes
    ----------
    iterations : list of IterationRow
    samples : evaluated points so far, with those excluded
    surface : RatioSurrogate or None
        The surrogates as last fitted.
    """

    def __init__(
        self,
        problem: WingProblem,
        noise: Noise,
        rng: np.random.Generator,
        journal: Journal | None = None,
    ) -> None:
        self.problem = problem
        self.noise = noise
        self.iterations: list[IterationRow] = []
        self.samples = Samples(problem.lower, problem.upper)
        self.surface: RatioSurrogate | None = None
        self.message = ""
        self._rng = rng
        self.goal = goal_of(problem)
        self.scatter = ControlScatter(noise, problem)
        self._batch = problem.batch_size or 1
        self._strict = problem.method not in FIXED_SIZE
        journal = Journal(None, {}, Evaluation) if journal is None else journal
        self._exchange = AskTell(self._algorithm(), journal, problem.control_point)

    @property
    def done(self) -> bool:
        """Whether the loop has ended, converged or not."""
        return self._exchange.done

    def ask(self) -> list[Request]:
        """Points to evaluate now; empty at the end. Fits and searches happen here and take seconds."""
        return self._exchange.ask()

    def tell(self, number: int, answer: Answer | Evaluation) -> None:
        """Answer one request; ``Answer(None, reason)`` excludes the point."""
        self._exchange.tell(number, answer if isinstance(answer, Answer) else Answer(answer))

    def _algorithm(self) -> Algorithm:
        problem = self.problem
        lower, upper = problem.lower, problem.upper
        initial = latin_hypercube(problem.initial_samples, lower, upper, self._rng)
        self.samples.add((yield [Point(x, "initial") for x in initial]))
        width = problem.window
        while True:
            surface = self.surface = self._fit()
            optimum = reliable_optimum(surface, problem, self.scatter, self._rng)
            _, max_mse = largest_mse(surface, problem, lower, upper, self._rng)
            if not self.samples.hold(optimum.x):
                self.samples.add((yield [Point(optimum.x, "optimum")]))
                self.surface = self._fit()
            if self._strict and self.iterations:
                before = self.iterations[-1]
                width = adapted(width, optimum.x - before.x, Window(before.window_lower, before.window_upper))
            window = moving_window(width, lower, upper, optimum.x)
            state = State(
                self.surface,
                problem,
                self.scatter,
                optimum,
                window,
                self.samples,
                self._rng,
                self._batch,
                len(self.iterations),
            )
            points, promise = new_samples(state)
            self._close_iteration(optimum, max_mse, window, promise)
            if self.iterations[-1].converged or self._spent(len(points)):
                return
            told = yield [Point(c.x, c.reason) for c in points]
            self.samples.add(told)
            self._require_progress(told)

    def _fit(self) -> RatioSurrogate:
        s = self.samples
        if len(s.X) < len(self.problem.names) + 2:
            raise WorkError(
                f"only {len(s.X)} of {len(s.X) + len(s.excluded)} points could be evaluated, too few for a "
                f"surrogate; the first reason: {s.excluded[0] if s.excluded else 'none'}"
            )
        return surface_of(self.problem).fit(s.X, s.lift, s.power, s.lift_std**2, s.power_std**2)

    def _close_iteration(self, optimum: Optimum, max_mse: float, window: Window, promise: float) -> None:
        response = self.samples.response_at(optimum.x)
        row = IterationRow(
            iteration=len(self.iterations),
            names=self.problem.names,
            x=optimum.x,
            prediction=optimum.prediction,
            prediction_std=optimum.prediction_std,
            response=response.lift_to_power if response else math.nan,
            response_std=response.lift_to_power_std if response else math.nan,
            mse=optimum.prediction_std**2,
            max_mse=max_mse,
            reliability=optimum.reliability,
            feasible=optimum.feasible,
            value=self.goal.sign * optimum.value,
            certain=not self.goal.constrained or self._agrees(optimum),
            promise=promise,
            window_lower=window.lower,
            window_upper=window.upper,
            evaluations=len(self.samples),
        )
        rows = [*self.iterations, row]
        verdict = judge(rows, self.problem.criteria, self._strict)
        self.iterations.append(
            replace(
                row,
                checked_mse=mean_square_error(rows),
                error_small=verdict.error_small,
                change_small=verdict.change_small,
                converged=verdict.converged,
            )
        )
        if verdict.converged:
            limited = self.goal.constrained
            self.message = "CC1, CC2 and the reliability requirement hold" if limited else "CC1 and CC2 hold"
            if self._strict:
                self.message += ", also at the low end of its band," if limited else ""
                self.message += " and no improvement is to be expected"

    def _agrees(self, optimum: Optimum) -> bool:
        """Whether also the low end of the band holds the requirement, to a tenth of the allowed failures.

        Where the requirement limits the design, the optimum lies on it, and no low end can be above.
        """
        allowed = 1.0 - self.problem.require.reliability
        return 1.0 - optimum.reliability.low <= _BAND * allowed

    def _spent(self, proposed: int) -> bool:
        problem = self.problem
        if proposed == 0:
            row = self.iterations[-1]
            self.message = (
                "stopped without convergence: no point is left that could tell more; the samples leave L/P "
                f"uncertain by {row.prediction_std:.2g} N/W and the reliability between "
                f"{row.reliability.low:.4f} and {row.reliability.high:.4f}"
            )
        elif len(self.iterations) > problem.max_iterations:
            self.message = f"stopped after max_iterations {problem.max_iterations} without convergence"
        elif len(self.samples) + proposed + 1 > problem.max_true_evaluations:
            self.message = (
                f"stopped at max_true_evaluations {problem.max_true_evaluations} without convergence"
            )
        return bool(self.message)

    def _require_progress(self, told: list[Told]) -> None:
        if told and all(t.outcome is None for t in told):
            raise WorkError(f"none of the new points could be evaluated: {'; '.join(t.note for t in told)}")

    def result(self, seed: int = 0) -> Result:
        """Give the design found, or the best so far when the loop has not ended.

        Raises
        ------
        WorkError
            No optimum has been searched yet.
        """
        if not self.iterations:
            raise WorkError("there is no result before the first iteration")
        row, problem = self.iterations[-1], self.problem
        message = self.message or "not finished"
        if not row.feasible:
            message = (
                f"no design reaches {self.goal.requirement} with reliability "
                f"{problem.require.reliability:g}; this one comes closest, with {row.reliability.value:.4f}. "
                + message
            )
        return Result(
            id=problem.id,
            kind=problem.kind,
            design=problem.named(row.x),
            units=dict(zip(problem.names, problem.units, strict=True)),
            objective=row.value,
            objective_std=self._objective_std(row),
            constraints=(Constraint(self.goal.requirement, row.reliability, problem.require.reliability),),
            iterations=row.iteration,
            true_evaluations=len(self.samples),
            converged=row.converged,
            feasible=row.feasible,
            message=message,
            history=tuple(r.to_json() for r in self.iterations),
            seed=seed,
            decisions=tuple(self._decisions()),
            excluded=tuple(self.samples.excluded),
            extra={
                "fixed": dict(problem.fixed),
                "noise": self.noise.to_json(),
                "objective_name": f"{self.goal.name} [{self.goal.unit}]",
                "lift_to_power": row.prediction,
                "lift_to_power_std": row.prediction_std,
                "outside_runs": self.samples.outside(),
                "response": row.response,
                "response_std": row.response_std,
            },
        )

    def _objective_std(self, row: IterationRow) -> float:
        """Error of the objective at the design: of the surrogate the goal looks at."""
        if self.surface is None or self.goal.name == "L/P":
            return row.prediction_std
        return float(self.goal.predict(self.surface, row.x[None])[1][0])

    def _decisions(self) -> Iterator[str]:
        problem = self.problem
        yield "order of the control variables: F, AoA, U; the headings of Tables 5 and 6 are exchanged"
        yield f"window width by rule '{problem.window.rule}': " + (
            "q (dU - dL)" if problem.window.rule == "range" else "q (dL + dU) as Eq. 11 is printed"
        )
        yield "the optimum is evaluated for CC1 in every iteration and then belongs to the samples"
        yield "CC2 compares predictions, as the text and the tables do"
        yield "columns mse and max_mse are the Kriging mean square error (Eq. 20); checked_mse of Eq. 10"
        yield "reliability is that of the mean surface; low and high show what its own error leaves open"
        outside = self.samples.outside()
        if outside:
            yield (
                f"{outside} of {len(self.samples.evaluations)} lifts were asked for outside of the range of "
                "the runs behind the lift table: they are extrapolations, taken with their uncertainty"
            )
        for name, dist in problem.distribution.items():
            yield f"{name} scatters with a {dist} distribution around its setting"
        for a, b, rho in problem.corr:
            yield f"scatter of {a} and {b} is correlated by a Gaussian copula, {rho:g}"
        for name in problem.fixed:
            yield f"{name} is fixed, so its scatter does not enter"
