# SPDX-License-Identifier: Apache-2.0
"""Evaluated points of a wing study; what cannot enter a surrogate is kept apart with its reason."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cwmav_rbdo.ask_tell import Told
from cwmav_rbdo.evaluation import Evaluation

Array = NDArray[np.float64]
_SAME = 1e-4  # of the range: closer points are one sample


class Samples:
    """Grows by whole batches, in the order of the requests whatever the order of the answers."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self._lower = lower
        self._range = upper - lower
        self._points: list[Array] = []
        self._evaluations: list[Evaluation] = []
        self.reasons: list[str] = []
        self.excluded: list[str] = []

    def add(self, told: Sequence[Told], reason: str = "") -> None:
        """Take the answers of one batch."""
        for t in told:
            if t.outcome is None:
                self.excluded.append(f"{np.array2string(t.x, precision=4)}: {t.note}")
            else:
                self._points.append(t.x)
                self._evaluations.append(t.outcome)

    def __len__(self) -> int:
        """Points asked for, the excluded ones included: what has been paid."""
        return len(self._points) + len(self.excluded)

    def hold(self, x: Array) -> bool:
        """Whether `x` is already a sample."""
        return self.response_at(x) is not None

    def response_at(self, x: Array, apart: float = _SAME) -> Evaluation | None:
        """Give the nearest evaluation that is no farther from `x` than a share of the ranges."""
        distances = np.max(np.abs(self.X - x) / self._range, axis=1) if self._points else np.array([np.inf])
        nearest = int(np.argmin(distances))
        return self._evaluations[nearest] if distances[nearest] <= apart else None

    @property
    def X(self) -> Array:  # noqa: N802 - the name of the field
        """Points (n, d) in the units of the problem."""
        return np.array(self._points).reshape(-1, len(self._range))

    @property
    def lift(self) -> Array:
        """Lift (n,) [N]."""
        return np.array([e.lift for e in self._evaluations])

    @property
    def lift_std(self) -> Array:
        """Standard uncertainty of the lift (n,) [N]."""
        return np.array([e.lift_std for e in self._evaluations])

    @property
    def power(self) -> Array:
        """Power (n,) [W]."""
        return np.array([e.power for e in self._evaluations])

    @property
    def power_std(self) -> Array:
        """Standard uncertainty of the power (n,) [W]."""
        return np.array([e.power_std for e in self._evaluations])

    def outside(self) -> int:
        """Count the lifts whose source says that they were asked for outside of the runs it knows."""
        return sum("outside" in e.lift_source for e in self._evaluations)

    @property
    def evaluations(self) -> tuple[Evaluation, ...]:
        """All usable evaluations, in the order of :attr:`X`."""
        return tuple(self._evaluations)
