# SPDX-License-Identifier: Apache-2.0
"""The studies that methods are compared on, each with its truth and what counts as having reached it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from cwmav_rbdo.benchmarks import published
from cwmav_rbdo.criteria import judge
from cwmav_rbdo.dispatch import Evaluator
from cwmav_rbdo.evaluation import Evaluation, Responses
from cwmav_rbdo.evaluators import TableEvaluator, power_model
from cwmav_rbdo.executors import problem_evaluator
from cwmav_rbdo.general.oracle import Oracle
from cwmav_rbdo.general.rbdo import refine
from cwmav_rbdo.journal import Journal
from cwmav_rbdo.loop import AcceleratedLoop
from cwmav_rbdo.problem import load_problem
from cwmav_rbdo.reproduction.study_runs import NOISE
from cwmav_rbdo.reproduction.surface import PaperSurface
from cwmav_rbdo.swarm import SwarmSettings
from cwmav_rbdo.window import WindowSettings
from cwmav_rbdo.wing_problem import WingProblem

Array = NDArray[np.float64]

REACHED = 0.005
"""Relative distance of the true objective from the true optimum that counts as having reached it."""
BETA = 0.05
"""Miss of a reliability index that still counts as holding the constraint."""
BUDGET = {"wing": 60, "published": 80}
_SWARM = SwarmSettings(particles=120, iterations=120, patience=20)
_LATTICE = 41


@dataclass(frozen=True)
class Outcome:
    """What one run of one method gave.

    Attributes
    ----------
    reached : int or None
        True evaluations after which the design of an iteration first was the optimum; None: never.
    stopped : int or None
        True evaluations after which the method's own criteria ended the run; None: never.
    gap : float
        Relative distance of the true objective from the optimum at that end, or at the end of the budget.
    """

    reached: int | None
    stopped: int | None
    gap: float


def wing(problem: WingProblem, evaluator: Evaluator, best: float, seed: int) -> Outcome:
    """Run a wing study past its own criteria until the optimum was reached and they have held."""
    loop = AcceleratedLoop(
        replace(problem, criteria=replace(problem.criteria, c1=1e-12)), NOISE, np.random.default_rng(seed)
    )
    reached: int | None = None
    stopped: int | None = None
    gap, seen = math.inf, 0
    strict = problem.method == "default"
    while requests := loop.ask():
        for request in requests:
            loop.tell(request.id, evaluator.submit(request.point).result())
        if len(loop.iterations) == seen:
            continue
        seen = len(loop.iterations)
        row = loop.iterations[-1]
        now = 1.0 - true_ratio(problem, evaluator, row.x) / best
        reached = row.evaluations if reached is None and now <= REACHED else reached
        if stopped is None:
            gap = now
            if judge(loop.iterations, problem.criteria, strict).converged:
                stopped = row.evaluations
        if reached is not None and stopped is not None:
            break
    return Outcome(reached, stopped, gap)


def true_ratio(problem: WingProblem, evaluator: Evaluator, x: Array) -> float:
    """L/P of the truth at a design."""
    found: float = evaluator.submit(problem.control_point(x)).result().lift_to_power
    return found


def true_best(problem: WingProblem, evaluator: Evaluator) -> float:
    """Largest L/P of the truth, by a lattice and a local search from its best three nodes."""
    axes = [np.linspace(lo, hi, _LATTICE) for lo, hi in zip(problem.lower, problem.upper, strict=True)]
    step = 1 if len(axes) < 3 else 3
    nodes = np.array(list(product(*(axis[::step] for axis in axes))))
    values = np.array([true_ratio(problem, evaluator, x) for x in nodes])
    best = float(values.max())

    def loss(x: Array) -> float:
        return -true_ratio(problem, evaluator, np.clip(x, problem.lower, problem.upper))

    for k in np.argsort(-values)[:3]:
        options = {"xatol": 1e-3, "fatol": 1e-8}
        found: Any = minimize(loss, nodes[k], method="Nelder-Mead", options=options)  # type: ignore[call-overload]
        best = max(best, -float(found.fun))
    return best


def published_problem(name: str, method: str, q: float, seed: int) -> Outcome:
    """Solve a published problem and find when its design first was the brute-force optimum.

    The paper's rules have no criterion of their own for several constraints: their runs end when the optimum
    is reached, or with the budget.
    """
    problem = published.benchmark_problem(name)
    best = published.reference(name)
    seen: list[tuple[float, int]] = []
    reached: int | None = None

    def watch(design: Array, objective: float, evaluations: int) -> bool:
        """Whether to go on."""
        nonlocal reached
        seen.append((abs(objective / best - 1.0), evaluations))
        if reached is None and seen[-1][0] <= REACHED and _holds(name, design):
            reached = evaluations
        return method == "default" or reached is None

    budget = min(BUDGET["published"], 2 * problem.max_true_evaluations)
    problem = replace(problem, method=method, window=WindowSettings(q), max_true_evaluations=budget)
    evaluator = problem_evaluator(problem)
    journal = Journal(None, {}, Responses)
    oracle = Oracle(evaluator, journal, budget, problem.dispatch, lambda: False)
    found = refine(problem, oracle, np.random.default_rng(seed), watch)
    stopped = oracle.calls if found.converged and method == "default" else None
    return Outcome(reached, stopped, seen[-1][0])


def _holds(name: str, design: Array) -> bool:
    problem = published.benchmark_problem(name)
    betas = published.true_betas(problem, design, samples=200_000)
    return bool(np.all(betas >= np.array(problem.beta_targets) - BETA))


class Exact:
    """An evaluator whose answers are the truth: its uncertainties are left out.

    A method is judged against the mean of the lift table. Told that every answer may be wrong by 15 mN, it
    would rightly not resolve the top of that mean to the last half per cent.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self.workers = evaluator.workers

    def submit(self, point: Array) -> Future[Evaluation]:
        """Evaluate at F [Hz], AoA [rad], U [m/s]."""
        future: Future[Evaluation] = Future()
        future.set_result(replace(self._evaluator.submit(point).result(), lift_std=0.0, power_std=0.0))
        return future

    def close(self) -> None:
        """Nothing to give back."""


def made_on(study: str) -> str:
    """Name the data behind a study that may be replaced by better ones; empty where it is a formula."""
    if not study.startswith("wing_table"):
        return ""
    content = (resources.files("cwmav_sim.data") / "lift_table.csv").read_bytes()
    runs = len(content.splitlines()) - 1
    return f"lift table {hashlib.sha256(content).hexdigest()[:8]} of {runs} runs"


@cache
def _wing_case(study: str) -> tuple[WingProblem, Evaluator, float]:
    problem = load_problem("three_variables.yaml" if study.endswith("3") else "two_variables.yaml")
    if not isinstance(problem, WingProblem):
        raise TypeError(study)
    problem = replace(
        problem,
        noise={name: NOISE.std(name) for name in ("F", "AoA", "U")},
        swarm=_SWARM,
        max_iterations=1000,
        max_true_evaluations=BUDGET["wing"],
    )
    evaluator: Evaluator = (
        Exact(TableEvaluator(power_model(problem))) if study.startswith("wing_table") else PaperSurface()
    )
    return problem, evaluator, true_best(problem, evaluator)


def wing_study(study: str) -> Callable[[str, float, int], Outcome]:
    """Give a wing study as a function of method, q and seed."""

    def run(method: str, q: float, seed: int) -> Outcome:
        problem, evaluator, best = _wing_case(study)
        return wing(replace(problem, method=method, window=WindowSettings(q)), evaluator, best, seed)

    return run
