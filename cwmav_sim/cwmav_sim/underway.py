# SPDX-License-Identifier: Apache-2.0
"""Wings that are in their periodic motion from time zero on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cwmav_sim.wing.prescribed import ClappingWings
from cwmav_sim.wing.sheet import IntArray, SheetState


@dataclass(frozen=True)
class UnderwayWings:
    """Prescribed wings whose start from rest lies whole cycles before time zero.

    Attributes
    ----------
    wings : ClappingWings
        The wings from rest.
    """

    wings: ClappingWings

    @property
    def since(self) -> float:
        """Time between the start from rest and time zero [s]: the fewest whole cycles that hold it."""
        return math.ceil(self.wings.kinematics.ramp_cycles) * self.wings.period

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle, shape (m, 3)."""
        return self.wings.triangles

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle, shape (m,)."""
        return self.wings.panel

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        return self.wings.panel_names

    @property
    def period(self) -> float:
        """Flapping period [s]."""
        return self.wings.period

    def state(self, t: float) -> SheetState:
        """Return position, velocity and acceleration of the nodes at time ``t`` [s]."""
        return self.wings.state(self.since + t)
