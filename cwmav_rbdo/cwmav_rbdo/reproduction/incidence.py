# SPDX-License-Identifier: Apache-2.0
"""The incidence offset: by how much the angle of attack of the paper's rig may differ from ours.

At zero angle a pair of equal wings, one above the other, lifts nothing; the paper measures lift there. One
constant, added to every printed angle, may explain that. It is found from the row at zero angle alone, so
every other row tests it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator

_LEAST = 3  # angles: below that an interpolation says nothing of the slope


def offset_for(angle_deg: Sequence[float], lift: Sequence[float], wanted: float) -> float | None:
    """Return the angle [deg] at which lifts [N] interpolated over the angle reach the ``wanted`` one.

    Parameters
    ----------
    angle_deg, lift : sequence of float
        Runs at one frequency and airspeed, in any order, one for each angle.
    wanted : float
        Lift that was measured at zero angle [N].

    Returns
    -------
    float or None
        The angle nearest to zero; None for fewer than three runs, or where the lift is not reached.
    """
    if len(angle_deg) < _LEAST:
        return None
    order = np.argsort(angle_deg)
    angle, excess = np.asarray(angle_deg)[order], np.asarray(lift)[order] - wanted
    curve = PchipInterpolator(angle, excess)
    roots = curve.roots(extrapolate=False)
    return float(min(roots, key=abs)) if len(roots) else None
