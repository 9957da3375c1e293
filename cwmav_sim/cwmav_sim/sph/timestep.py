# SPDX-License-Identifier: Apache-2.0
"""Time step: dt = C min( sqrt(h / |a|max), h / c ), c the fastest signal.

(J. J. Monaghan, A. Kos, J. Waterw. Port Coast. Ocean Eng. 125 (1999) 145, without the viscous rate, which at
these Reynolds numbers is far below the acoustic one.)
"""

from __future__ import annotations

import math


def stable_step(cfl: float, h: float, signal_speed: float, acceleration: float) -> float:
    """Return the largest stable time step [s] for a signal speed [m/s] and an acceleration [m/s2]."""
    acoustic = h / signal_speed
    inertial = math.sqrt(h / acceleration) if acceleration > 0.0 else math.inf
    return cfl * min(acoustic, inertial)
