# SPDX-License-Identifier: Apache-2.0
"""What is asked of an expensive model and its answers: values passed between loop, journal and evaluators."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Request:
    """One point that has to be evaluated.

    `x` is in the units of the problem file and in the order of its design variables; `point` is what
    evaluators receive: for the wing always the complete control point (F in Hz, AoA in rad, U in m/s), else
    `x` itself.
    """

    id: int
    x: Array
    point: Array
    reason: str


class Outcome(Protocol):
    """An answer of any evaluator."""

    def defect(self) -> str:
        """Say what makes the answer unusable; empty when nothing does."""
        ...

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        ...

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Restore what :meth:`to_json` gave."""
        ...


@dataclass(frozen=True)
class Evaluation:
    """Lift and power of one control point with standard uncertainties and where they came from [N, W]."""

    lift: float
    lift_std: float
    power: float
    power_std: float
    lift_source: str = ""
    power_source: str = ""

    def defect(self) -> str:
        """Name the number that cannot enter a surrogate: not finite, negative scatter, or no power."""
        for name in ("lift", "lift_std", "power", "power_std"):
            if not math.isfinite(getattr(self, name)):
                return f"{name} is {getattr(self, name)}"
        for name in ("lift_std", "power_std"):
            if getattr(self, name) < 0:
                return f"{name} is {getattr(self, name):g}, expected >= 0"
        return "" if self.power > 0 else f"power is {self.power:g} W, expected > 0"

    @property
    def lift_to_power(self) -> float:
        """Ratio L/P [N/W]."""
        return self.lift / self.power

    @property
    def lift_to_power_std(self) -> float:
        """Standard uncertainty of the ratio to first order, lift and power independent [N/W]."""
        return math.hypot(self.lift_std, self.lift_to_power * self.power_std) / self.power

    def to_json(self) -> dict[str, Any]:
        """Give plain values; :meth:`from_json` restores the same numbers bit for bit."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Restore what :meth:`to_json` gave."""
        return cls(**values)


@dataclass(frozen=True)
class Responses:
    """Values of the expensive functions of a general problem at one point: constraints, or the objective."""

    values: tuple[float, ...]

    def defect(self) -> str:
        """Name the first value that is not finite."""
        for index, value in enumerate(self.values):
            if not math.isfinite(value):
                return f"response {index + 1} is {value}"
        return ""

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return {"values": list(self.values)}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Restore what :meth:`to_json` gave."""
        return cls(tuple(float(v) for v in values["values"]))


@dataclass(frozen=True)
class Answer:
    """What became of a request: an outcome, or None with the reason when every attempt failed."""

    outcome: Any
    note: str = ""
    attempts: int = 1
