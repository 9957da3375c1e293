# SPDX-License-Identifier: Apache-2.0
"""Time step: dt = min( C sqrt(h / |a|max), C h / c, h^2 / (8 nu) ), c the fastest signal.

(J. J. Monaghan, A. Kos, J. Waterw. Port Coast. Ocean Eng. 125 (1999) 145, without the viscous rate of pairs;
the diffusive limit is that of J. P. Morris et al., J. Comput. Phys. 136 (1997) 214, and never rules in air.)
"""

from __future__ import annotations

import math


def stable_step(
    cfl: float, h: float, signal_speed: float, acceleration: float, viscosity: float = 0.0
) -> float:
    """Return the largest stable time step [s].

    Parameters
    ----------
    cfl, h : float
        Courant number and smoothing length [m].
    signal_speed, acceleration, viscosity : float
        Highest signal speed [m/s], largest acceleration [m/s2], kinematic viscosity [m2/s].
    """
    acoustic = h / signal_speed
    inertial = math.sqrt(h / acceleration) if acceleration > 0.0 else math.inf
    diffusive = 0.125 * h**2 / viscosity if viscosity > 0.0 else math.inf
    return min(cfl * min(acoustic, inertial), diffusive)
