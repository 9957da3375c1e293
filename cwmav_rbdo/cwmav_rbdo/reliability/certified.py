# SPDX-License-Identifier: Apache-2.0
"""The exact reliability of designs: the better of two quadratures, judged by their own errors.

Line-root quadrature is at its best where failure lies on one side, directional quadrature where it lies all
around. Which of the two a design needs, their errors say: the second is asked only where the first doubts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cwmav_rbdo.reliability.directional import LARGEST_DIMENSION, directional, directional_estimate
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.inputs import LimitState
from cwmav_rbdo.reliability.line_root import line_root, line_root_estimate

Array = NDArray[np.float64]

DOUBT = 5e-5
"""Error of a probability beyond which the second quadrature is asked, for many designs."""
SURE = 1e-6
"""The same for one design, of which no doubt need be left."""


def certified(
    g: LimitState, designs: ArrayLike, std: ArrayLike, order: int = 9, angles: int = 48
) -> tuple[Array, Array]:
    """Probability of failure of many designs and its error; (m,) each. See :func:`line_root`."""
    X = np.atleast_2d(np.asarray(designs, dtype=np.float64))
    spread = np.broadcast_to(np.asarray(std, dtype=np.float64), X.shape)
    pf, error, _ = line_root(g, X, spread, order)
    doubted = np.flatnonzero(error > DOUBT)
    if len(doubted) and np.count_nonzero(np.any(spread > 0.0, axis=0)) <= LARGEST_DIMENSION:
        other, other_error, _ = directional(g, X[doubted], spread[doubted], angles)
        better = other_error < error[doubted]
        pf[doubted[better]], error[doubted[better]] = other[better], other_error[better]
    return pf, error


def certified_estimate(g: LimitState, design: ArrayLike, std: ArrayLike) -> Estimate:
    """Probability of failure of one design by the better of the two, each with finer nodes."""
    found = line_root_estimate(g, design, std)
    scattering = np.count_nonzero(np.asarray(std) > 0.0)
    if found.std <= SURE or scattering > LARGEST_DIMENSION:
        return found
    other = directional_estimate(g, design, std)
    return other if other.std < found.std else found
