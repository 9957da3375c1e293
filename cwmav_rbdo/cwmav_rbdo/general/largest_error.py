# SPDX-License-Identifier: Apache-2.0
"""The paper's rules of new samples, for problems of kind ``rbdo``: largest Kriging error (Eqs. 11 and 20).

They are there to be compared with. With several constraints the error is the largest of them, each in units
of the variance of its responses. As in the wing study the optimum itself is sampled in every round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_rbdo.general.design import Design
from cwmav_rbdo.general.surrogates import Surrogates
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.swarm import PyswarmsSwarm, SwarmSettings
from cwmav_rbdo.window import moving_window

Array = NDArray[np.float64]
_SWARM = SwarmSettings(particles=150, iterations=150, patience=20)


def paper_samples(
    problem: GeneralProblem,
    space: RandomSpace,
    surrogates: Surrogates,
    design: Design,
    rng: np.random.Generator,
) -> Array:
    """Give the optimum, the largest error in the space and, for ``zhang2026``, that in the window; (n, D)."""
    lower, upper = space.box(problem.lower, problem.upper)
    centre = np.clip(space.physical(np.zeros((1, space.dimension)), design.d)[0], lower, upper)
    scale = np.maximum(surrogates.Y.var(axis=0), 1e-300)

    def certainty(X: Array) -> Array:
        errors = [surrogates.predict(k, X)[1] ** 2 / scale[k] for k in range(len(scale))]
        return np.asarray(-np.max(errors, axis=0))

    swarm = PyswarmsSwarm(_SWARM)
    proposed = [centre, swarm.minimise(certainty, lower, upper, rng).x]
    if problem.method == "zhang2026":
        window = moving_window(problem.window, lower, upper, centre)
        proposed.append(swarm.minimise(certainty, window.lower, window.upper, rng).x)
    kept = [x for x in proposed if not surrogates.near(x, upper - lower)]
    return np.array(kept).reshape(-1, len(lower))
