# SPDX-License-Identifier: Apache-2.0
"""Line sampling: random lines towards failure, each integrated exactly.

Of Koutsourelakis, Pradlwarter and Schueller (2004, Prob. Eng. Mech. 19:409). Where the limit state is nearly
plane, all lines say nearly the same, and a few of them replace a million random points. Every crossing of a
line counts, on both sides of the origin, so no direction is wrong; a bad one only costs precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cwmav_common.errors import InputError
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.form import find_design_points
from cwmav_rbdo.reliability.inputs import Inputs, LimitState, standard_limit_state
from cwmav_rbdo.reliability.line_root import failed_on_lines

Array = NDArray[np.float64]


def line_sampling(
    g: LimitState,
    inputs: Inputs,
    rng: np.random.Generator,
    lines: int = 400,
    direction: ArrayLike | None = None,
) -> Estimate:
    """Average the failed part of random lines.

    Parameters
    ----------
    g : callable
    inputs : Inputs
    rng : numpy.random.Generator
    lines : int
        Each costs 25 evaluations and three for every crossing.
    direction : (d,) array, optional
        Of the lines, in the standard normal space; by default that of the nearest design point.

    Returns
    -------
    Estimate

    Raises
    ------
    InputError
        On fewer than two lines, or a direction that is none.
    """
    if lines < 2:
        raise InputError(f"lines = {lines}: allowed is an integer >= 2")
    evaluate = standard_limit_state(g, inputs)
    spent = 0
    if direction is None:
        points, spent = find_design_points(evaluate, inputs.dimension, rng, 5)
        nearest = min(points, key=lambda p: abs(p.beta), default=None)
        direction = np.eye(inputs.dimension)[0] if nearest is None else nearest.u
    axis = np.asarray(direction, dtype=np.float64)
    size = float(np.linalg.norm(axis))
    if axis.shape != (inputs.dimension,) or not math.isfinite(size) or size == 0.0:
        raise InputError(f"direction: {axis}; expected {inputs.dimension} finite numbers, not all zero")
    axis = axis / size
    base = rng.standard_normal((lines, inputs.dimension))
    base -= np.outer(base @ axis, axis)

    def on_lines(rows: NDArray[np.int_], t: Array) -> Array:
        return evaluate(base[rows] + t[:, None] * axis)

    failed, evaluations = failed_on_lines(on_lines, lines)
    std = float(failed.std(ddof=1)) / math.sqrt(lines)
    return Estimate(float(failed.mean()), std, spent + evaluations, "line_sampling")
