# SPDX-License-Identifier: Apache-2.0
"""Factors of a tangent that stay good while the wings swing.

They are kept together with the orientation of the carrier frames in which they were built; right-hand sides
are turned back into those frames and solutions forth, so that the stroke itself does not make them stale.
"""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.arithmetic import Solvable
from cwmav_sim.wing.drive import Carrier
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.motion_loops import turned_rows
from cwmav_sim.wing.sheet import FloatArray

_SHORTER, _LONGER = 0.8, 1.25  # steps, over that of the factors, for which they still serve


class CarriedFactors:
    """Factors of a tangent with the frames they were built in.

    Parameters
    ----------
    factors : Solvable
        Factors of the free rows.
    system : System
        The structure.
    carrier : Carrier
        Frames in which the tangent was built.
    step : float
        Step for which it was built [s].
    """

    def __init__(self, factors: Solvable, system: System, carrier: Carrier, step: float) -> None:
        self._factors, self._system, self._axes, self._step = factors, system, carrier.axes, step

    def stale(self, step: float) -> bool:
        """Return whether they are of no use for another step [s]."""
        return not _SHORTER < step / self._step < _LONGER

    def solve(self, right: FloatArray, carrier: Carrier) -> FloatArray:
        """Return the solution for a right-hand side of the free rows (f, 3) in the frames of ``carrier``."""
        forth = carrier.axes @ np.swapaxes(self._axes, 1, 2)
        back = np.ascontiguousarray(np.swapaxes(forth, 1, 2))
        return self._turned(forth, self._factors.solve(self._turned(back, right)))

    def _turned(self, rotations: FloatArray, a: FloatArray) -> FloatArray:
        arithmetic, places = self._system.arithmetic, self._system.places
        out, there = arithmetic.empty(*a.shape), arithmetic.brought(rotations)
        arithmetic.run(turned_rows, len(a), there, places.group, places.free, a, out)
        return out
