# SPDX-License-Identifier: Apache-2.0
"""Solves published problems with default settings and judges the answers by the formulas themselves.

Passing means, for ``rbdo``: the objective within 0.5 % of the brute-force optimum and every reliability
index, by Monte Carlo on the formulas, no lower than its target by more than 0.05 (and no higher where it is
active at the optimum), in no more evaluations than a tenth of those of the classical method where that
needs more than 400, else no more than it. For ``reliability``: within 5 % of the exact or brute-force
probability. For ``global``: within 0.01 of the known least value.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cwmav_common.errors import CwmavError, InputError
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.problem import parse_problem
from cwmav_rbdo.result import Result
from cwmav_rbdo.study import run_study

Array = NDArray[np.float64]

_OBJECTIVE, _BETA, _PROBABILITY, _LEAST = 0.005, 0.05, 0.05, 0.01
_CHECK, _BLOCK = 1_000_000, 100_000
_CLASSICAL_FROM, _SHARE = 400, 10
_BUDGET = {"rbdo": 400, "reliability": 600, "global": 100}


@dataclass(frozen=True)
class BenchmarkRow:
    """One solved problem; `error` says why there is no answer."""

    name: str
    kind: str
    design: Mapping[str, float]
    objective: float
    reference_objective: float
    constraints: Sequence[Mapping[str, Any]]
    true_evaluations: int
    allowed_evaluations: int
    passed: bool
    error: str = ""


@cache
def _problems() -> dict[str, dict[str, Any]]:
    text = (resources.files("cwmav_rbdo.data") / "benchmark_problems.json").read_text(encoding="utf-8")
    return {entry["id"]: entry for entry in json.loads(text)["problems"]}


def benchmark_names() -> list[str]:
    """Names of all problems."""
    return list(_problems())


def benchmark_problem(name: str) -> GeneralProblem:
    """Give one problem with its budget.

    Raises
    ------
    InputError
        There is none of that name.
    """
    if name not in _problems():
        raise InputError(f"benchmark '{name}' is unknown; allowed: {', '.join(_problems())}")
    entry = _problems()[name]
    budget = (
        max(_allowed(entry), _BUDGET[entry["kind"]]) if entry["kind"] == "reliability" else _allowed(entry)
    )
    problem = parse_problem(entry | {"max_true_evaluations": budget}, name)
    if not isinstance(problem, GeneralProblem):
        raise TypeError(f"{name} is a wing study")
    return problem


def run_benchmark(name: str, seed: int = 0) -> BenchmarkRow:
    """Solve one problem and judge the answer."""
    problem, entry = benchmark_problem(name), _problems()[name]
    try:
        result = run_study(problem, seed=seed)
    except CwmavError as error:
        nothing = float("nan")
        return BenchmarkRow(
            name, problem.kind, {}, nothing, _reference(entry), (), 0, _allowed(entry), False, str(error)
        )
    judged = {"rbdo": _judge_rbdo, "reliability": _judge_reliability, "global": _judge_global}
    return judged[problem.kind](problem, entry, result)


def _allowed(entry: Mapping[str, Any]) -> int:
    """Count what a good answer may take: a tenth of SORA's calls, all where few; those of AK-MCS."""
    if entry["kind"] == "reliability":
        return int(entry["published"]["evals"]["AK-MCS+U"])
    calls = entry.get("recomputed", {}).get("true_g_calls_classical", {}).get("sora_g_calls")
    if calls is None:
        return _BUDGET[entry["kind"]]
    return int(calls) // _SHARE if calls > _CLASSICAL_FROM else int(calls)


def _reference(entry: Mapping[str, Any]) -> float:
    recomputed = entry.get("recomputed", {})
    if entry["kind"] == "rbdo":
        return float(recomputed["mc_optimum"]["f"])
    if entry["kind"] == "reliability":
        return float(recomputed.get("pf_exact", recomputed["pf_mc"]))
    return float(entry["f_opt"])


def _judge_rbdo(problem: GeneralProblem, entry: Mapping[str, Any], result: Result) -> BenchmarkRow:
    betas = true_betas(problem, np.array([result.design[n] for n in problem.names]))
    active = [
        b is not None and abs(b - t) < 0.2
        for b, t in zip(_optimal_betas(entry), problem.beta_targets, strict=True)
    ]
    checks = []
    for k, constraint in enumerate(result.constraints):
        target = problem.beta_targets[k]
        good = betas[k] >= target - _BETA and (not active[k] or betas[k] <= target + _BETA)
        checks.append(
            constraint.to_json() | {"true_beta": betas[k], "target_beta": target, "passed": bool(good)}
        )
    near = abs(result.objective - _reference(entry)) <= _OBJECTIVE * abs(_reference(entry))
    passed = near and result.feasible and all(c["passed"] for c in checks)
    return _row(problem, entry, result, result.objective, checks, passed)


def _judge_reliability(problem: GeneralProblem, entry: Mapping[str, Any], result: Result) -> BenchmarkRow:
    pf = float(result.extra["pf"])
    passed = result.converged and abs(pf / _reference(entry) - 1.0) <= _PROBABILITY
    checks = [
        {
            "name": "system",
            "reliability": 1.0 - pf,
            "reliability_std": result.extra["pf_std"],
            "passed": passed,
        }
    ]
    return _row(problem, entry, result, pf, checks, passed)


def _judge_global(problem: GeneralProblem, entry: Mapping[str, Any], result: Result) -> BenchmarkRow:
    return _row(
        problem, entry, result, result.objective, (), abs(result.objective - _reference(entry)) <= _LEAST
    )


def _row(
    problem: GeneralProblem,
    entry: Mapping[str, Any],
    result: Result,
    objective: float,
    checks: Sequence[Mapping[str, Any]],
    passed: bool,
) -> BenchmarkRow:
    within = result.true_evaluations <= _allowed(entry)
    return BenchmarkRow(
        problem.id,
        problem.kind,
        dict(result.design),
        objective,
        _reference(entry),
        checks,
        result.true_evaluations,
        _allowed(entry),
        bool(passed and within),
    )


def _optimal_betas(entry: Mapping[str, Any]) -> list[float | None]:
    betas: list[float | None] = entry["recomputed"]["mc_optimum"]["beta"]
    return betas


def reference(name: str) -> float:
    """Brute-force optimum, exact or brute-force probability, or least value of a problem."""
    return _reference(_problems()[name])


def true_betas(problem: GeneralProblem, d: Array, seed: int = 20_260_101, samples: int = 0) -> Array:
    """Reliability indices of the formulas at a design, by a Monte Carlo that no solver has seen."""
    count = samples or _CHECK
    space, rng = RandomSpace(problem), np.random.default_rng(seed)
    failures = np.zeros(len(problem.constraints))
    for _ in range(count // _BLOCK):
        X = space.physical(rng.standard_normal((_BLOCK, space.dimension)), d)
        g = problem.functions.limit_states(dict(zip(space.names, X.T, strict=True)))
        failures += np.count_nonzero(g <= 0.0, axis=0)
    return np.asarray(-ndtri(np.clip(failures / count, 0.5 / count, 1.0 - 0.5 / count)))
