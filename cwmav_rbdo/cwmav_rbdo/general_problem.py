# SPDX-License-Identifier: Apache-2.0
"""Any reliability-based problem as a file: design, random variables, formulas, targets.

Three kinds: ``rbdo`` (least objective under probabilistic constraints), ``reliability`` (failure probability,
no design variables) and ``global`` (least expensive objective within bounds). Constraints are safe where
positive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_rbdo.dispatch import DispatchSettings
from cwmav_rbdo.expressions import CONSTANTS, FUNCTIONS, Function, Rows, compile_function
from cwmav_rbdo.marginals import DISTRIBUTIONS, copula_factor
from cwmav_rbdo.window import WindowSettings
from cwmav_rbdo.wing_problem import METHODS, DesignVariable, SurrogateSettings

Array = NDArray[np.float64]
KINDS = ("rbdo", "reliability", "global")
RELIABILITY_METHODS = (
    "active_learning",
    "monte_carlo",
    "importance_sampling",
    "subset_simulation",
    "line_sampling",
    "form",
)


@dataclass(frozen=True)
class RandomVariable:
    """What nature chooses; `mean` may be the name of a design variable, scatter is given as std or cov."""

    name: str = setting(..., "name")
    mean: float | str = setting(..., "mean, or the name of the design variable that is the mean")
    dist: str = setting("normal", "distribution", choices=DISTRIBUTIONS)
    std: float | str | None = setting(None, "standard deviation > 0, or a formula of the design variables")
    cov: float | None = setting(None, "standard deviation divided by the mean", gt=0)

    def __post_init__(self) -> None:
        if (self.std is None) == (self.cov is None):
            raise InputError(f"random variable {self.name}: give exactly one of std and cov")
        if isinstance(self.std, int | float) and not self.std > 0:
            raise InputError(f"random variable {self.name}: std is {self.std}; allowed: numbers > 0")
        if self.dist not in DISTRIBUTIONS:
            raise InputError(
                f"random variable {self.name}: dist is '{self.dist}'; allowed: {', '.join(DISTRIBUTIONS)}"
            )


@dataclass(frozen=True)
class GeneralProblem:
    """A declared problem with its formulas compiled on first use."""

    id: str = setting(..., "name of the problem; names the run folder")
    kind: str = setting(..., "kind of problem", choices=KINDS)
    title: str = setting("", "one line about it")
    design: tuple[DesignVariable, ...] = setting((), "design variables")
    random: tuple[RandomVariable, ...] = setting((), "random variables")
    corr: tuple[tuple[str, str, float], ...] = setting((), "pairs with their Gaussian copula correlation")
    let: tuple[tuple[str, str | float], ...] = setting((), "intermediate formulas, in order")
    objective: str = setting("", "what is minimised; 'maximise:' in front turns it round")
    constraints: tuple[str, ...] = setting((), "probabilistic constraints, safe when > 0")
    deterministic_constraints: tuple[str, ...] = setting((), "constraints on the design alone, met when >= 0")
    beta_target: float | tuple[float, ...] | None = setting(
        None, "required reliability index, one or per constraint"
    )
    pf_target: float | tuple[float, ...] | None = setting(
        None, "allowed failure probability, one or per constraint"
    )
    reliability_target: float | tuple[float, ...] | None = setting(
        None, "required reliability, one or per constraint"
    )
    max_true_evaluations: int = setting(200, "budget of evaluated points", ge=4, le=1000000)
    reliability_method: str = setting(
        "active_learning",
        f"kind reliability: {', '.join(RELIABILITY_METHODS)}, or python:package.module:function of your own",
    )
    method: str = setting(
        "default",
        "new samples of kind rbdo; zhang2026 and classical are the paper's rules, for comparison",
        choices=METHODS,
    )
    window: WindowSettings = field(default_factory=WindowSettings)
    surrogate: SurrogateSettings = field(default_factory=lambda: SurrogateSettings(trend="auto"))
    dispatch: DispatchSettings = field(default_factory=DispatchSettings)

    def __post_init__(self) -> None:
        _check_names(self)
        _check_shape(self)
        _ = (
            self.beta_targets,
            self.functions,
        )  # errors in targets and formulas belong to reading the problem

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the design variables."""
        return tuple(v.name for v in self.design)

    @property
    def lower(self) -> Array:
        """Lower bounds (d,)."""
        return np.array([v.lo for v in self.design])

    @property
    def upper(self) -> Array:
        """Upper bounds (d,)."""
        return np.array([v.hi for v in self.design])

    @cached_property
    def beta_targets(self) -> tuple[float, ...]:
        """Required reliability index of each constraint; empty where the kind has none."""
        if self.kind != "rbdo":
            return ()
        given = [self.beta_target, self.pf_target, self.reliability_target]
        if sum(value is not None for value in given) != 1:
            raise InputError("give exactly one of beta_target, pf_target and reliability_target")
        if self.beta_target is not None:
            return _per_constraint("beta_target", self.beta_target, self.constraints, -8.0, 8.0)
        if self.pf_target is not None:
            values = _per_constraint("pf_target", self.pf_target, self.constraints, 0.0, 1.0)
            return tuple(float(-norm.ppf(p)) for p in values)
        values = _per_constraint("reliability_target", self.reliability_target, self.constraints, 0.0, 1.0)
        return tuple(float(norm.ppf(r)) for r in values)

    @cached_property
    def functions(self) -> Functions:
        """The compiled formulas."""
        return _compile(self)


@dataclass(frozen=True)
class Functions:
    """Compiled formulas of a problem; `lets` are evaluated first, in order."""

    lets: tuple[tuple[str, Function], ...]
    design_lets: tuple[tuple[str, Function], ...]
    objective: Function | None
    sign: float
    constraints: tuple[Function, ...]
    deterministic: tuple[Function, ...]

    def minimised(self, rows: Rows) -> Array:
        """Objective with the sign of a minimisation, (n,)."""
        if self.objective is None:
            raise InputError("this problem has no objective")
        return self.sign * self.objective(_with(rows, self.design_lets))

    def limit_states(self, rows: Rows) -> Array:
        """Values of the probabilistic constraints, (n, K)."""
        complete = _with(rows, self.lets)
        return np.stack([g(complete) for g in self.constraints], axis=1)

    def design_constraints(self, rows: Rows) -> Array:
        """Values of the deterministic constraints, (n, M)."""
        complete = _with(rows, self.design_lets)
        n = len(next(iter(rows.values())))
        return (
            np.stack([g(complete) for g in self.deterministic], axis=1)
            if self.deterministic
            else np.ones((n, 0))
        )


def _with(rows: Rows, lets: Sequence[tuple[str, Function]]) -> Rows:
    complete = dict(rows)
    for name, function in lets:
        complete[name] = function(complete)
    return complete


def _compile(problem: GeneralProblem) -> Functions:
    known = [*problem.names, *(v.name for v in problem.random)]
    design_known = list(problem.names)
    lets, design_lets = [], []
    for index, (name, text) in enumerate(problem.let):
        function = compile_function(text, known, f"let[{index}] {name}")
        lets.append((name, function))
        known.append(name)
        if (
            set(getattr(function, "names", None) or ()) <= set(design_known)
            and getattr(function, "names", 0) is not None
        ):
            design_lets.append((name, function))
            design_known.append(name)
    objective: Any = problem.objective
    sign = 1.0
    if isinstance(objective, str):
        objective = objective.strip()
        sign = -1.0 if objective.startswith(("maximise:", "maximize:")) else 1.0
        objective = objective.partition(":")[2] if sign < 0 else objective
    return Functions(
        lets=tuple(lets),
        design_lets=tuple(design_lets),
        objective=compile_function(objective, design_known, "objective") if objective else None,
        sign=sign,
        constraints=tuple(
            compile_function(g, known, f"constraints[{k}]") for k, g in enumerate(problem.constraints)
        ),
        deterministic=tuple(
            compile_function(g, design_known, f"deterministic_constraints[{k}]")
            for k, g in enumerate(problem.deterministic_constraints)
        ),
    )


def _check_names(problem: GeneralProblem) -> None:
    names = [*problem.names, *(v.name for v in problem.random), *(name for name, _ in problem.let)]
    for name in names:
        if not name.isidentifier() or name in FUNCTIONS or name in CONSTANTS:
            raise InputError(
                f"'{name}' cannot be a name; use letters, digits and _ and no name of a function"
            )
        if names.count(name) > 1:
            raise InputError(f"'{name}' is declared twice")
    for variable in problem.random:
        if isinstance(variable.mean, str) and variable.mean not in problem.names:
            allowed = ", ".join(problem.names) or "(none)"
            raise InputError(
                f"random variable {variable.name}: mean '{variable.mean}' is no number and no design "
                f"variable; design variables: {allowed}"
            )
        if isinstance(variable.std, str):
            compile_function(variable.std, problem.names, f"random variable {variable.name}: std")
    copula_factor([v.name for v in problem.random], problem.corr)


def _check_shape(problem: GeneralProblem) -> None:
    kind, method = problem.kind, problem.reliability_method
    if method not in RELIABILITY_METHODS and not method.startswith("python:"):
        allowed = ", ".join(RELIABILITY_METHODS)
        raise InputError(
            f"reliability_method is '{method}'; allowed: {allowed}, or python:package.module:function"
        )
    wants = {
        "rbdo": (True, True, True, True),
        "reliability": (False, True, False, True),
        "global": (True, False, True, False),
    }[kind]
    has = (bool(problem.design), bool(problem.random), bool(problem.objective), bool(problem.constraints))
    for key, wanted, given in zip(("design", "random", "objective", "constraints"), wants, has, strict=True):
        if wanted != given:
            raise InputError(f"kind '{kind}' {'needs' if wanted else 'has no'} {key}")
    if kind == "reliability" and any(isinstance(v.mean, str) for v in problem.random):
        raise InputError("kind 'reliability' has no design variables, so every mean must be a number")


def _per_constraint(
    key: str, value: object, constraints: Sequence[str], low: float, high: float
) -> tuple[float, ...]:
    values = value if isinstance(value, tuple) else (value,) * len(constraints)
    if len(values) != len(constraints):
        raise InputError(f"{key}: {len(values)} values for {len(constraints)} constraints")
    for v in values:
        if not isinstance(v, int | float) or not math.isfinite(v) or not low < v < high:
            raise InputError(f"{key}: {v!r} is not allowed; expected a number between {low:g} and {high:g}")
    return tuple(map(float, values))
