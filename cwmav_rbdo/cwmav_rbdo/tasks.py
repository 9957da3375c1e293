# SPDX-License-Identifier: Apache-2.0
"""One evaluation as a function of plain values, for processes and machines that know nothing of a study.

A worker, here or on another machine, is sent the text of a problem and a point, and answers with the outcome.
What is slow to make (a fitted lift table, compiled formulas) is made once per process.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Any

import numpy as np

from cwmav_rbdo.evaluators import FormulaEvaluator, TableEvaluator, power_model
from cwmav_rbdo.general.variables import evaluated_names
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.problem import Problem, parse_problem, problem_mapping

_KEPT = 4  # problems whose evaluators a process keeps


def task_text(problem: Problem) -> str:
    """Write a problem as the text that :func:`evaluate_task` takes."""
    return json.dumps(problem_mapping(problem), sort_keys=True)


def evaluate_task(text: str, point: tuple[float, ...]) -> Any:
    """Evaluate one point; the outcome, or the exception of the function itself.

    Parameters
    ----------
    text : of :func:`task_text`
    point : what an evaluator's ``submit`` receives
    """
    return _evaluation(text)(np.array(point))


@lru_cache(maxsize=_KEPT)
def _evaluation(text: str) -> Any:
    problem = parse_problem(json.loads(text), "problem of a task")
    if isinstance(problem, GeneralProblem):
        formulas = FormulaEvaluator(problem, evaluated_names(problem))
        return lambda point: formulas.submit(point).result()
    power = power_model(problem)
    if problem.evaluate == "table" or problem.source.fidelity == "table":
        table = TableEvaluator(power)
        return lambda point: table.submit(point).result()
    return _LiveRun(power, problem.source.fidelity)


class _LiveRun:
    """A run of the solver in this process: a cluster's worker is a process of its own already."""

    def __init__(self, power: Any, preset: str) -> None:
        self._power, self._preset = power, preset

    def __call__(self, point: np.ndarray) -> Any:
        from cwmav_rbdo.evaluation import Evaluation
        from cwmav_sim.case import preset as case_of
        from cwmav_sim.run import simulate

        f, a, u = point.tolist()
        run = simulate(case_of(self._preset).at(f, math.degrees(a), u))
        power = self._power.predict(f, a, u)
        return Evaluation(
            run.mean_lift, run.lift_std, power.power, power.power_std, run.source(), power.source
        )
