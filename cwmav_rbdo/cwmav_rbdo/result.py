# SPDX-License-Identifier: Apache-2.0
"""What a study gives: the rows of its history and the design found, as values and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.cli import plain
from cwmav_rbdo.criteria import relative_error

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Band:
    """A reliability: with its standard error, and the band that the surrogate's own uncertainty leaves."""

    value: float
    std: float
    low: float
    high: float
    method: str

    def to_json(self) -> dict[str, Any]:
        """Give the keys of the contract."""
        return {
            "reliability": self.value,
            "reliability_std": self.std,
            "reliability_low": self.low,
            "reliability_high": self.high,
            "method": self.method,
        }


@dataclass(frozen=True)
class IterationRow:
    """One iteration with the columns of the paper's Tables 5 and 6; designs in the units of the problem."""

    iteration: int
    names: tuple[str, ...]
    x: Array
    prediction: float
    """L/P at the optimum from the surrogate [N/W]."""
    prediction_std: float
    response: float
    """L/P evaluated at the optimum [N/W]; NaN when it could not be evaluated."""
    response_std: float
    mse: float
    """Kriging mean square error at the optimum (Eq. 20) [(N/W)^2]."""
    max_mse: float
    """Its maximum over the design space."""
    reliability: Band
    feasible: bool
    window_lower: Array
    window_upper: Array
    evaluations: int
    """Points evaluated up to and including the check of this optimum: the column 'solves'."""
    value: float = math.nan
    """Objective of the goal; L/P itself for the goal ratio."""
    certain: bool = True
    """Whether the band on the reliability agrees with the requirement."""
    promise: float = math.nan
    """Largest expected improvement, relative to the prediction; NaN where the method does not ask for it."""
    checked_mse: float = math.nan
    """Mean square error over the optima evaluated so far, each predicted before it was evaluated (Eq. 10)."""
    error_small: bool = False
    change_small: bool = False
    converged: bool = False

    @property
    def error(self) -> float:
        """Relative error of the prediction (Eq. 12)."""
        return relative_error(self.prediction, self.response)

    def to_json(self) -> dict[str, Any]:
        """Give plain values under names with units where they are not SI."""
        return {
            "iteration": self.iteration,
            "design": dict(zip(self.names, self.x.tolist(), strict=True)),
            "lift_to_power": self.prediction,
            "lift_to_power_std": self.prediction_std,
            "response": self.response,
            "response_std": self.response_std,
            "mse": self.mse,
            "max_mse": self.max_mse,
            "checked_mse": self.checked_mse,
            "error_percent": 100.0 * self.error,
            "reliability": self.reliability.value,
            "reliability_std": self.reliability.std,
            "reliability_low": self.reliability.low,
            "reliability_high": self.reliability.high,
            "feasible": self.feasible,
            "certain": self.certain,
            "objective": self.prediction if math.isnan(self.value) else self.value,
            "promise": self.promise,
            "window_lower": self.window_lower.tolist(),
            "window_upper": self.window_upper.tolist(),
            "evaluations": self.evaluations,
            "cc1": self.error_small,
            "cc2": self.change_small,
            "converged": self.converged,
        }


@dataclass(frozen=True)
class Constraint:
    """How reliably one constraint holds at the design found."""

    name: str
    band: Band
    target: float

    @property
    def met(self) -> bool:
        """Whether the reliability reaches its target, or misses it by no more than two standard errors.

        An optimum lies on the limit of its active constraints, so half of them would be called missed by
        an estimate that is right to its error.
        """
        return self.band.value + 2.0 * self.band.std >= self.target

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return {"name": self.name, **self.band.to_json(), "target": self.target, "met": self.met}


@dataclass(frozen=True)
class Result:
    """Outcome of a study of any kind."""

    id: str
    kind: str
    design: Mapping[str, float]
    units: Mapping[str, str]
    objective: float
    objective_std: float
    constraints: tuple[Constraint, ...]
    iterations: int
    true_evaluations: int
    converged: bool
    feasible: bool
    message: str
    history: tuple[Mapping[str, Any], ...]
    seed: int
    decisions: tuple[str, ...] = ()
    excluded: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Give exactly what ``cwmav-rbdo run --json`` prints; NaN becomes null."""
        content = {
            "id": self.id,
            "kind": self.kind,
            "design": dict(self.design),
            "units": dict(self.units),
            "objective": self.objective,
            "objective_std": self.objective_std,
            "constraints": [c.to_json() for c in self.constraints],
            "iterations": self.iterations,
            "true_evaluations": self.true_evaluations,
            "converged": self.converged,
            "feasible": self.feasible,
            "message": self.message,
            "seed": self.seed,
            "decisions": list(self.decisions),
            "excluded": list(self.excluded),
            "history": list(self.history),
            **self.extra,
        }
        values: dict[str, Any] = plain(content)
        return values


def known(value: float) -> bool:
    """Whether a number is there at all."""
    return math.isfinite(value)
