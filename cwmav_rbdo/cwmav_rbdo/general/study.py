# SPDX-License-Identifier: Apache-2.0
"""A general problem from its file to its result and run folder."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cwmav_rbdo.dispatch import Evaluator
from cwmav_rbdo.evaluation import Responses
from cwmav_rbdo.executors import problem_evaluator
from cwmav_rbdo.general.failure_probability import solve_reliability
from cwmav_rbdo.general.global_optimum import solve_global
from cwmav_rbdo.general.oracle import Oracle
from cwmav_rbdo.general.rbdo import solve_rbdo
from cwmav_rbdo.general.variables import evaluated_names
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.journal import Journal
from cwmav_rbdo.problem import digest, problem_mapping
from cwmav_rbdo.reliability import UnsureError
from cwmav_rbdo.result import Result
from cwmav_rbdo.run_folder import RunFolder


def run_general_study(
    problem: GeneralProblem,
    evaluator: Evaluator | None = None,
    *,
    seed: int = 0,
    run_folder: RunFolder | None = None,
    resume: bool = False,
    cancelled: Callable[[], bool] = lambda: False,
) -> Result:
    """Solve a problem that is no wing study; see :func:`cwmav_rbdo.study.run_study`."""
    names = evaluated_names(problem)
    if run_folder is not None and not resume:
        run_folder.write_config(
            {
                "program": "cwmav-rbdo",
                "seed": seed,
                "problem": problem_mapping(problem),
                "evaluated": list(names),
            }
        )
    header = {"problem": digest(problem), "seed": seed}
    journal = Journal(None if run_folder is None else run_folder.journal, header, Responses, resume=resume)
    try:
        own = None if evaluator else problem_evaluator(problem)
        try:
            oracle = Oracle(
                evaluator or own,  # type: ignore[arg-type]
                journal,
                problem.max_true_evaluations,
                problem.dispatch,
                cancelled,
            )
            result = _SOLVERS[problem.kind](problem, oracle, seed)
        finally:
            if own is not None:
                own.close()
    finally:
        journal.close()
    if run_folder is not None:
        run_folder.write_iterations(result.history)
        run_folder.write_result(result.to_json())
    return result


def _rbdo(problem: GeneralProblem, oracle: Oracle, seed: int) -> Result:
    found = solve_rbdo(problem, oracle, np.random.default_rng(seed))
    design = dict(zip(problem.names, found.design.d.tolist(), strict=True))
    feasible = found.design.violation <= 0.0
    message = found.message
    if not feasible:
        miss = found.design.violation
        by = (
            f"misses by {miss:.2f} in the reliability index"
            if math.isfinite(miss)
            else "fails whatever its scatter"
        )
        message = f"no design holds all constraints; this one {by}. {message}"
    history = tuple(
        {
            "iteration": r.iteration,
            "design": dict(zip(problem.names, r.design.tolist(), strict=True)),
            "objective": r.objective,
            "violation_beta": r.violation,
            "largest_doubt": max(r.doubt),
            "evaluations": r.evaluations,
        }
        for r in found.rounds
    )
    return Result(
        id=problem.id,
        kind=problem.kind,
        design=design,
        units={},
        objective=found.design.objective,
        objective_std=0.0,
        constraints=found.constraints,
        iterations=len(history) - 1,
        true_evaluations=oracle.calls,
        converged=found.converged,
        feasible=feasible,
        message=message,
        history=history,
        seed=seed,
        decisions=(
            "the objective is a cheap formula of the design and is not counted as an evaluation",
            "reliabilities are Monte Carlo on the surrogates; low and high show what their error leaves open",
        ),
        excluded=tuple(oracle.excluded),
    )


def _reliability(problem: GeneralProblem, oracle: Oracle, seed: int) -> Result:
    message = ""
    try:
        estimate = solve_reliability(problem, oracle, np.random.default_rng(seed))
    except UnsureError as error:
        estimate, message = error.estimate, f"stopped at max_true_evaluations {oracle.budget}: {error}; "
    return Result(
        id=problem.id,
        kind=problem.kind,
        design={},
        units={},
        objective=float("nan"),
        objective_std=float("nan"),
        constraints=(),
        iterations=0,
        true_evaluations=oracle.calls,
        converged=not message,
        feasible=True,
        message=f"{message}failure probability {estimate.value:.5g} +- {estimate.std:.2g} "
        f"by {estimate.method}",
        history=(),
        seed=seed,
        excluded=tuple(oracle.excluded),
        extra={
            "pf": estimate.value,
            "pf_std": estimate.std,
            "beta": estimate.beta,
            "method": estimate.method,
        },
    )


def _global(problem: GeneralProblem, oracle: Oracle, seed: int) -> Result:
    found = solve_global(problem, oracle, np.random.default_rng(seed))
    sign = problem.functions.sign
    return Result(
        id=problem.id,
        kind=problem.kind,
        design=dict(zip(problem.names, found.x.tolist(), strict=True)),
        units={},
        objective=sign * found.f,
        objective_std=0.0,
        constraints=(),
        iterations=len(found.history) - 1,
        true_evaluations=oracle.calls,
        converged=found.converged,
        feasible=True,
        message="the search came to rest"
        if found.converged
        else f"stopped at max_true_evaluations {oracle.budget}",
        history=tuple({"iteration": k, "objective": sign * f} for k, f in enumerate(found.history)),
        seed=seed,
        excluded=tuple(oracle.excluded),
    )


_SOLVERS = {"rbdo": _rbdo, "reliability": _reliability, "global": _global}
