# SPDX-License-Identifier: Apache-2.0
"""What a verification case is and what it reports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True)
class Check:
    """One number against its reference.

    Attributes
    ----------
    name : str
        Name of the case.
    quantity : str
        What was measured, with its unit.
    value, reference : float
        Found and expected.
    scale : float
        What an error is compared with; the reference itself unless that is zero.
    tolerance_percent : float
        Largest error that passes, of the scale.
    source : str
        Where the reference comes from.
    """

    name: str
    quantity: str
    value: float
    reference: float
    scale: float
    tolerance_percent: float
    source: str

    @property
    def error_percent(self) -> float:
        """Signed error in per cent of the scale."""
        return 100.0 * (self.value - self.reference) / abs(self.scale)

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; an undefined value never passes."""
        return math.isfinite(self.value) and abs(self.error_percent) <= self.tolerance_percent

    def to_json(self) -> dict[str, Any]:
        """Return the public keys."""
        return {
            "name": self.name,
            "quantity": self.quantity,
            "value": self.value,
            "reference": self.reference,
            "error_percent": self.error_percent,
            "tolerance_percent": self.tolerance_percent,
            "passed": self.passed,
            "source": self.source,
        }


class VerificationCase(Protocol):
    """A run with a known answer.

    A case may also have a ``remark``: what is known of the cause where it misses a bar; and ``flexible``,
    true where it runs the structure of flexible wings.
    """

    @property
    def name(self) -> str:
        """Name on the command line."""
        ...

    @property
    def summary(self) -> str:
        """One line saying what is tested."""
        ...

    @property
    def slow(self) -> bool:
        """Whether it takes longer than about two minutes on two cores."""
        ...

    def run(self) -> list[Check]:
        """Run the case and compare."""
        ...
