# SPDX-License-Identifier: Apache-2.0
"""Reliability-based optimisation of Python functions in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cwmav_common.errors import InputError
from cwmav_rbdo.general_problem import GeneralProblem, RandomVariable
from cwmav_rbdo.result import Result
from cwmav_rbdo.study import run_study
from cwmav_rbdo.wing_problem import DesignVariable

Formula = str | Callable[..., Any]


def optimise(
    objective: Formula,
    constraints: Sequence[Formula],
    design: Mapping[str, tuple[float, float]],
    random: Mapping[str, tuple[str, float | str, float]],
    *,
    beta_target: float | Sequence[float] = 3.0,
    max_true_evaluations: int = 200,
    seed: int = 0,
    **settings: Any,
) -> Result:
    """Minimise an objective under probabilistic constraints.

    Parameters
    ----------
    objective : callable or str
        Cheap function of design variables, or a formula. Functions receive arrays by the names of
        their parameters and return one value per row.
    constraints : sequence of callables or str
        Expensive functions of random and design variables, safe when > 0.
    design : mapping
        Name to bounds (lo, hi).
    random : mapping
        Name to (distribution, mean, standard deviation); a mean may be the name of a design variable.
    beta_target : float or one per constraint
        Required reliability index.
    max_true_evaluations : int
        Budget; all constraints at one point count as one.
    seed : int
    settings
        Other fields of :class:`~cwmav_rbdo.general_problem.GeneralProblem`.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        Something in the problem is not allowed; the message says what is.

    Examples
    --------
    >>> result = optimise(
    ...     "w", [lambda w, load: w - load], {"w": (0.0, 10.0)}, {"load": ("normal", 3.0, 0.5)},
    ...     beta_target=2.0, max_true_evaluations=30,
    ... )
    >>> bool(abs(result.objective - 4.0) < 0.02)
    True
    """
    variables = []
    for name, entry in random.items():
        if len(entry) != 3:
            raise InputError(f"random variable {name}: {entry!r}; expected (distribution, mean, std)")
        dist, mean, std = entry
        variables.append(RandomVariable(name=name, dist=dist, mean=mean, std=std))
    problem = GeneralProblem(
        id=str(settings.pop("id", "problem")),
        kind="rbdo",
        design=tuple(DesignVariable(name, lo, hi) for name, (lo, hi) in design.items()),
        random=tuple(variables),
        objective=objective,  # type: ignore[arg-type]
        constraints=tuple(constraints),  # type: ignore[arg-type]
        beta_target=beta_target if isinstance(beta_target, int | float) else tuple(beta_target),
        max_true_evaluations=max_true_evaluations,
        **settings,
    )
    return run_study(problem, seed=seed)
