# SPDX-License-Identifier: Apache-2.0
"""An evaluator with a known best ratio, for tests of the optimiser."""

from __future__ import annotations

import math
from concurrent.futures import Future
from dataclasses import replace

import numpy as np

from cwmav_rbdo.evaluation import Evaluation
from cwmav_rbdo.noise import Noise, Scatter
from cwmav_rbdo.problem import load_problem
from cwmav_rbdo.swarm import SwarmSettings
from cwmav_rbdo.wing_problem import Requirement, WingProblem

BEST = np.array([10.4, 21.5])  # Hz, deg
PEAK = 0.131  # N/W
NOISE = Noise({"F": Scatter(0.153), "AoA": Scatter(0.462), "U": Scatter(0.05)}, "test")


def evaluate(point):
    """Lift and power at F [Hz], AoA [rad], U [m/s]; L/P has its peak PEAK at BEST."""
    f, a, _ = point
    ratio = PEAK * math.exp(-(((f - BEST[0]) / 9.0) ** 2) - ((math.degrees(a) - BEST[1]) / 25.0) ** 2)
    power = 0.4 + 0.06 * f + 0.2 * math.sin(a) ** 2
    return Evaluation(ratio * power, 1e-5, power, 1e-5, "bowl", "bowl")


class BowlEvaluator:
    """Evaluates the bowl, counting; `fail` names the calls that raise."""

    def __init__(self, workers=1, fail=(), stop_after=None):
        self.workers = workers
        self.points = []
        self.closed = False
        self._fail = set(fail)
        self._stop_after = stop_after

    def submit(self, point):
        if self._stop_after is not None and len(self.points) >= self._stop_after:
            raise KeyboardInterrupt
        self.points.append(tuple(point))
        future = Future()
        if len(self.points) - 1 in self._fail:
            future.set_exception(RuntimeError("the tunnel is closed"))
        else:
            future.set_result(evaluate(point))
        return future

    def close(self):
        self.closed = True


def small_problem(**changes) -> WingProblem:
    """Give the two-variable study with a small swarm."""
    problem = load_problem("two_variables.yaml")
    swarm = SwarmSettings(particles=80, iterations=80, patience=15)
    noise = {"F": 0.153, "AoA": 0.462, "U": 0.05}
    require = Requirement(lift_to_power=0.12, reliability=0.9974)
    return replace(problem, **({"swarm": swarm, "noise": noise, "require": require} | changes))
